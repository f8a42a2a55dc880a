"""Arms made up at random, with no more structure than their closed form needs, and some of it anti-parallel and mirrored."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from pieper.ik.closed_form import solve_closed_form
from pieper.ik.family import Family, find_family
from pieper.ik.solve import solver
from pieper.kinematics.fk import fk
from pieper.model.chain import Chain
from pieper.spatial.rotation import from_rotation_vector
from tests.ik.test_closed_form import apart, check_accuracy, found
from tests.ik.test_family import disturbed

KINDS = {
    "spherical, 2 and 3 parallel": ((1, 2), (), "parallel_23"),
    "spherical, 1 and 2 parallel": ((0, 1), (), "parallel_12"),
    "spherical, 1 and 2 meet": ((), (0, 1), "intersecting_12"),
    "spherical, 2 and 3 meet": ((), (1, 2), "intersecting_23"),
    "spherical": ((), (), "general"),
    "three parallel, 5 and 6 meet": ((1, 2, 3), (4, 5), ""),
    "three parallel": ((1, 2, 3), (), ""),
    "five joints": ((1, 2, 3), (), ""),
}


def random_arm(kind: str, seed: int, *, mirrored: bool = False) -> Chain:
    """A chain with axes through random points in random directions, but for the relations of its kind."""
    rng = np.random.default_rng(seed)
    parallel, meeting, _ = KINDS[kind]
    n = 5 if kind == "five joints" else 6
    w = rng.normal(size=(n, 3))
    w /= np.linalg.norm(w, axis=-1, keepdims=True)
    p = rng.uniform(-1, 1, (n, 3))
    for i in parallel[1:]:
        w[i] = w[parallel[0]] * rng.choice([-1.0, 1.0])
    for axes in (meeting, (3, 4, 5) if kind.startswith("spherical") else ()):
        for i in axes[1:]:  # slid along itself, so that the point where they meet is nobody's origin
            p[i] = p[axes[0]] + w[i] * rng.uniform(-1, 1)
    screws = np.hstack([np.cross(p, w), w])
    if mirrored:
        screws = -screws[::-1]
    home = np.eye(4)
    home[:3, :3] = from_rotation_vector(rng.normal(size=3))
    home[:3, 3] = rng.uniform(-1, 1, 3)
    return Chain(kind, screws, home, np.tile([-np.pi, np.pi], (n, 1)), tuple(f"q{i}" for i in range(n)))


def well_posed(arm: Chain) -> bool:
    """Leaves out arms that are nearly of another kind: neighbours nearly parallel."""
    w = np.where(arm.is_revolute[:, None], arm.screws[:, 3:], arm.screws[:, :3])
    sines = np.linalg.norm(np.cross(w[:-1], w[1:]), axis=-1)
    return bool(((sines > 0.15) | (sines < 1e-12)).all())


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_every_answer_of_random_arms(kind, mirrored):
    tried = 0
    for seed in range(40):
        arm = random_arm(kind, seed, mirrored=mirrored)
        if not well_posed(arm):
            continue
        family = find_family(arm)
        assert family.has_closed_form, (seed, family.reason)
        assert family.level == "exact"
        assert family.reversed == (mirrored and arm.dof == 6)  # five joints look the same from both ends
        assert family.first_three == KINDS[kind][2]
        q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (400, arm.dof))
        T = fk(arm, q)
        answers = solve_closed_form(arm, family, T)
        assert found(answers, q).all(), seed
        check_accuracy(answers, arm, T)
        tried += 1
    assert tried > 15


SMALL = {
    "planar 2R": ("RR", 1),
    "planar 3R": ("RRR", 2),
    "SCARA, slide last": ("RRRP", 2),
    "SCARA, slide third": ("RRPR", 2),
    "SCARA, slide first": ("PRRR", 2),
    "two axes and a slide": ("RPR", 1),
    "slides alone": ("PPP", 1),
    "gantry, one axis": ("PPPR", 1),
    "gantry, two axes": ("PPPRR", 1),
    "gantry with a wrist": ("PPPRRR", 2),
    "wrist on slides, read from the tip": ("RRRPPP", 2),
    "Stanford arm": ("RRPRRR", 8),
}


def small_arm(pattern: str, seed: int) -> Chain:
    """An arm of turning and sliding joints; all axes are parallel in patterns of up to four that turn."""
    rng = np.random.default_rng(seed)
    n = len(pattern)
    w = rng.normal(size=(n, 3))
    w /= np.linalg.norm(w, axis=-1, keepdims=True)
    p = rng.uniform(-1, 1, (n, 3))
    if "PPP" not in pattern and n < 5:
        w = w[:1] * rng.choice([-1.0, 1.0], (n, 1))
    if pattern == "RRPRRR":
        p[1], p[4:] = p[0], p[3]
    slides = np.array([c == "P" for c in pattern])[:, None]
    screws = np.where(slides, np.hstack([w, 0 * w]), np.hstack([np.cross(p, w), w]))
    home = np.eye(4)
    home[:3, 3] = rng.uniform(-1, 1, 3)
    return Chain(pattern, screws, home, np.tile([-np.pi, np.pi], (n, 1)), tuple(f"q{i}" for i in range(n)))


@pytest.mark.parametrize("kind", SMALL)
def test_small_arms_and_slides(kind):
    pattern, most = SMALL[kind]
    tried = 0
    for seed in range(20):
        arm = small_arm(pattern, seed)
        if len(pattern) > 4 and not well_posed(arm):
            continue
        if "PPP" in pattern and abs(np.linalg.det(arm.screws[~arm.is_revolute][:, :3])) < 0.05:
            continue
        family = find_family(arm)
        assert family.has_closed_form, family.reason
        assert family.max_solutions == most
        q = np.random.default_rng(seed).uniform(-2, 2, (300, arm.dof))
        T = fk(arm, q)
        answers = solve_closed_form(arm, family, T)
        assert found(answers, q).all()
        assert 1 <= answers.valid.sum(axis=-1).max() <= most
        turning = arm.is_revolute
        assert (
            np.abs(fk(arm, answers.q[answers.valid])[:, :3] - np.repeat(T, answers.valid.sum(-1), 0)[:, :3]).max()
            < 1e-9
        )
        assert (np.abs(answers.q[answers.valid][:, turning]) <= np.pi).all()
        if arm.dof < 6:  # orientations that the arm cannot take
            T[:, :3, :3] = T[:, :3, :3] @ from_rotation_vector(1e-3 * np.random.default_rng(77).normal(size=(300, 3)))
            assert not solve_closed_form(arm, family, T).valid.any()
        tried += 1
    assert tried > 5


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "five joints"])
def test_answers_answer_each_other(kind):
    """Every answer's pose has the same answers: none is lost on some branches only."""
    for seed in range(6):
        arm = random_arm(kind, seed)
        family = find_family(arm)
        if not family.has_closed_form:
            continue
        q = np.random.default_rng(seed + 100).uniform(-np.pi, np.pi, (60, 6))
        first = solve_closed_form(arm, family, fk(arm, q))
        counts = first.valid.sum(axis=-1)
        for k in range(len(q)):
            again = solve_closed_form(arm, family, fk(arm, first.q[k][first.valid[k]]))
            assert (again.valid.sum(axis=-1) == counts[k]).all()


@pytest.mark.parametrize("kind", KINDS)
def test_near_folds_an_answer_is_never_false(kind):
    """Poses on the edge of what the arm reaches, between two of its own answers that have almost met."""
    arm = random_arm(kind, 3)
    family: Family = find_family(arm)
    if not family.has_closed_form:
        pytest.skip("not well posed")
    rng = np.random.default_rng(9)
    q = rng.uniform(-np.pi, np.pi, (3000, arm.dof))
    T = fk(arm, q)
    T[:, :3, 3] += rng.normal(size=(3000, 3)) * 10.0 ** rng.uniform(-12, 0, (3000, 1))
    answers = solve_closed_form(arm, family, T)
    check_accuracy(answers, arm, T)
    for several, valid in zip(answers.q, answers.valid, strict=True):
        one = several[valid]
        if len(one) > 1:
            assert (apart(one[:, None], one[None]) + 10 * np.eye(len(one))).min() > 1e-7


@pytest.mark.parametrize("kind", KINDS)
def test_rounded_random_arms_lose_nothing_unsaid(kind):
    """With every axis a little off, a lost answer is always at a pose that is called doubtful."""
    solved = 0
    for seed in range(12):
        exact = random_arm(kind, seed)
        arm = disturbed(exact, 3e-7, 3e-7, seed)
        if not well_posed(exact):
            continue
        family = find_family(arm)
        if not family.has_closed_form:
            continue
        assert family.level == "rounded"
        q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (1000, arm.dof))
        T = fk(arm, q)
        answers = solve_closed_form(arm, family, T)
        check_accuracy(answers, arm, T)
        assert (found(answers, q, within=1e-5) | answers.doubtful).all(), seed
        assert answers.doubtful.mean() < 0.5
        solved += 1
    assert solved > 3


@pytest.mark.parametrize("first", range(4))
def test_three_parallel_axes_at_any_position_and_with_any_signs(first):
    """In closed form at 2-3-4 and 3-4-5, by the polynomial at 1-2-3 and 4-5-6: the caller sees no difference."""
    tried = 0
    for signs in itertools.product([1.0, -1.0], repeat=2):
        for seed in range(6):
            rng = np.random.default_rng(seed)
            w = rng.normal(size=(6, 3))
            w /= np.linalg.norm(w, axis=-1, keepdims=True)
            w[first + 1], w[first + 2] = signs[0] * w[first], signs[1] * w[first]
            screws = np.hstack([np.cross(rng.uniform(-1, 1, (6, 3)), w), w])
            home = np.eye(4)
            home[:3, 3] = rng.uniform(-1, 1, 3)
            arm = Chain("trio", screws, home, np.tile([-np.pi, np.pi], (6, 1)), tuple(f"q{i}" for i in range(6)))
            if not well_posed(arm):
                continue
            prepared = solver(arm)
            assert prepared.method == ("closed form" if first in (1, 2) else "general")
            q = rng.uniform(-np.pi, np.pi, (100, 6))
            answers = prepared.solve(fk(arm, q))
            distance = np.abs(np.remainder(answers.q - q[:, None] + np.pi, 2 * np.pi) - np.pi).max(axis=-1)
            assert (np.nanmin(distance, axis=1) < 1e-5).all(), (first, signs, seed)
            tried += 1
    assert tried > 10
