"""The general solver with a prismatic joint among the six, at each place: recall, truth from elsewhere, bad input."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from pieper.errors import ArrayError
from pieper.ik.closed_form import solve_closed_form
from pieper.ik.family import find_family
from pieper.ik.general_6r import Flag, prepare, solve_general_6r
from pieper.ik.numeric import solve_numeric
from pieper.kinematics.fk import fk
from pieper.kinematics.jacobian import jacobian
from pieper.model.chain import Chain
from tests.reference import determinant_polynomial as determinant
from tests.reference import product_of_exponentials as exponentials

ACCURACY = 1e-9  # [m, rad] of every answer
SAME = 1e-6  # [rad, m]: a random pose is far enough from singular ones for its joints to come back that well
STROKE = (-0.5, 1.0)  # m
PLACES = range(6)
KINDS = ("generic", "right angles")


def link(theta, d, a, alpha):
    """A link after Denavit and Hartenberg, (4, 4)."""
    (ct, ca), (st, sa) = np.cos([theta, alpha]), np.sin([theta, alpha])
    return np.array([[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0, sa, ca, d], [0, 0, 0, 1]])


def arm_of(links, slides, name, limits=None):
    T = np.eye(4)
    screws = []
    for i, step in enumerate(links):
        z, p = T[:3, 2], T[:3, 3]
        screws.append(np.concatenate([z, 0 * z] if i in slides else [np.cross(p, z), z]))
        T = T @ step
    if limits is None:
        limits = [STROKE if i in slides else (-np.pi, np.pi) for i in range(6)]
    return Chain(name, screws, T, limits, [f"j{i}" for i in range(6)])


@cache
def slide_arm(place, kind, seed):
    """Random links; with right angles the axes are square to each other or parallel, and few lengths are zero."""
    rng = np.random.default_rng([seed, place])
    links = []
    for _ in range(6):
        if kind == "generic":
            numbers = (*rng.uniform(-np.pi, np.pi, 2), *rng.uniform(-0.5, 0.5, 2))
            links.append(link(numbers[0], numbers[2], numbers[3], numbers[1]))
        else:
            turned, tilted = rng.choice([0, np.pi / 2]), rng.choice([-np.pi / 2, np.pi / 2])
            links.append(link(turned, rng.choice([0, 0.2, -0.35]), rng.uniform(0.1, 0.5), tilted))
    return arm_of(links, (place,), f"slide {place}, {kind} {seed}")


def stanford():
    """Scheinman's arm of 1969: two square axes, a slide, a wrist; lengths of Paul's book [m]."""
    p, up, across = np.array([0.0, 0.154, 0.412]), np.array([0, 0, 1.0]), np.array([0, 1.0, 0])
    wrist = p + np.array([0, 0, 0.3])
    screws = [np.concatenate([np.cross(q, w), w]) for q, w in ((0 * p, up), (p, across))]
    screws.append(np.array([0, 0, 1.0, 0, 0, 0]))
    screws += [np.concatenate([np.cross(wrist, w), w]) for w in (up, across, up)]
    home = np.eye(4)
    home[:3, 3] = wrist + np.array([0, 0, 0.263])
    limits = [(-np.pi, np.pi)] * 2 + [(-0.2, 0.8)] + [(-np.pi, np.pi)] * 3
    return Chain("stanford", screws, home, limits, [f"j{i}" for i in range(6)])


def joints_of(arm, count, seed=1):
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (count, 6))
    slides = np.flatnonzero(~arm.is_revolute)
    low, high = arm.limits[slides].T
    q[:, slides] = np.random.default_rng(seed + 1).uniform(low, high, (count, len(slides)))
    return q


def apart(arm, q, wanted):
    """Largest difference of a joint, modulo whole turns of those that turn; infinite for rows of NaN."""
    distance = q - wanted
    distance = np.where(arm.is_revolute, (distance + np.pi) % (2 * np.pi) - np.pi, distance)
    distance = np.abs(distance).max(axis=-1)
    return np.where(np.isnan(distance), np.inf, distance)


def check_answers(arm, answers, T):
    """By the forward kinematics of the reference, some of them."""
    assert np.nanmax(answers.position_error, initial=0.0) < ACCURACY
    assert np.nanmax(answers.rotation_error, initial=0.0) < ACCURACY
    for k in np.ndindex(answers.valid.shape):
        if answers.valid[k]:
            assert np.abs(exponentials.fk(arm, answers.q[k]) - T[k[:-1]]).max() < ACCURACY


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("place", PLACES)
def test_generating_joints_are_among_the_answers(place, kind, instruction_set):
    for seed in range(4):
        arm = slide_arm(place, kind, seed)
        q = joints_of(arm, 1000, seed)
        T = fk(arm, q)
        answers = solve_general_6r(arm, T)
        singular = np.linalg.svd(jacobian(arm, q), compute_uv=False)[:, -1] < 1e-5
        assert (apart(arm, answers.q, q[:, None]).min(axis=1)[~singular] < SAME).all(), seed
        assert answers.valid.any(axis=1).all()
        assert answers.count.max() <= 16
        check_answers(arm, type(answers)(*(a[:10] for a in vars(answers).values())), T[:10])
        assert np.nanmax(answers.position_error) < ACCURACY
        assert np.nanmax(answers.rotation_error) < ACCURACY


@pytest.mark.parametrize("place", PLACES)
def test_roots_of_the_reference_determinant_are_the_answers(place):
    """The companion matrix of a determinant by singular values: as many answers, with the same remaining joint."""
    arm = slide_arm(place, "generic", 8)
    for T in fk(arm, joints_of(arm, 1, 5)):
        answers = solve_general_6r(arm, T)
        for joint in range(6):
            if place in (joint, (joint + 3) % 6):
                continue
            beyond = np.abs(determinant.spectrum(arm, T, joint))
            beyond[determinant.SAMPLES // 2 - 8 : determinant.SAMPLES // 2 + 9] = 0.0
            assert beyond.max() < 1e-11  # rounding of 12x12 determinants
            expected = np.sort(answers.q[answers.valid][:, joint])
            found = determinant.roots(arm, T, joint)
            assert len(found) == len(expected)
            assert np.abs((found - expected + np.pi) % (2 * np.pi) - np.pi).max() < 1e-6  # companion matrix


def test_stanford_arm_as_its_closed_form():
    arm = stanford()
    family = find_family(arm)
    assert family.max_solutions == 8
    q = joints_of(arm, 3000)
    T = fk(arm, q)
    closed, general = solve_closed_form(arm, family, T), solve_general_6r(arm, T)
    assert (apart(arm, general.q, q[:, None]).min(axis=1) < SAME).all()
    same = (general.count == closed.valid.sum(axis=1)) | (np.abs(np.sin(q[:, 4])) < 1e-6)
    assert same.all()
    for one, every in zip(closed.q, general.q, strict=True):
        assert (apart(arm, every[:, None], one[~np.isnan(one[:, 0])]).min(axis=0) < SAME).all()


@pytest.mark.parametrize("place", PLACES)
def test_numeric_answers_are_among_them(place):
    arm = slide_arm(place, "generic", 6)
    wide = Chain(arm.name, arm.screws, arm.home, [(-4.0, 4.0)] * 6, arm.joint_names)
    T = fk(arm, joints_of(arm, 8, 6))
    every = solve_general_6r(wide, T).q
    some = solve_numeric(wide, T, count=8, restarts=128).q
    assert np.isfinite(some[:, 0, 0]).all()
    for found, all_of_them in zip(some, every, strict=True):
        for q in found[~np.isnan(found[:, 0])]:
            assert apart(arm, all_of_them, q).min() < SAME


@pytest.mark.parametrize("place", PLACES)
def test_answers_answer_each_other(place):
    """Every answer's pose has the same answers, also those beyond the stroke: limits are not looked at."""
    arm = slide_arm(place, "right angles", 7)
    first = solve_general_6r(arm, fk(arm, joints_of(arm, 40, 7)))
    for answers, count in zip(first.q, first.count, strict=True):
        again = solve_general_6r(arm, fk(arm, answers[:count]))
        assert (again.count == count).all()


def test_the_slide_is_in_metres_and_is_not_wrapped():
    """A rail ten metres long, and one without limits."""
    limits = [(-10.0, 10.0)] + [(-np.pi, np.pi)] * 5
    for low, high in (limits[0], (-np.inf, np.inf)):
        arm = slide_arm(0, "generic", 3)
        arm = Chain("rail", arm.screws, arm.home, [(low, high), *limits[1:]], arm.joint_names)
        q = joints_of(Chain("rail", arm.screws, arm.home, limits, arm.joint_names), 500)
        answers = solve_general_6r(arm, fk(arm, q))
        assert (apart(arm, answers.q, q[:, None]).min(axis=1) < SAME).all()


def test_the_remaining_joint_turns():
    for place in PLACES:
        for joint in prepare(slide_arm(place, "generic", 0)).remaining_joints:
            assert place not in (joint, (joint + 3) % 6)


def test_batch_order_and_threads():
    arm = slide_arm(2, "right angles", 1)
    T = fk(arm, joints_of(arm, 200))
    together = solve_general_6r(arm, T)
    order = np.random.default_rng(1).permutation(200)
    np.testing.assert_array_equal(solve_general_6r(arm, T[order], threads=3).q, together.q[order])
    assert solve_general_6r(arm, T[:6].reshape(3, 1, 2, 4, 4)).q.shape == (3, 1, 2, 16, 6)


def test_nothing_is_found_out_of_reach():
    """A slide reaches anywhere along its axis, but not far from it."""
    for place in PLACES:
        arm = slide_arm(place, "generic", 2)
        T = fk(arm, joints_of(arm, 50))
        T[:, :3, 3] += 50.0 * np.linalg.qr(np.random.default_rng(place).normal(size=(50, 3, 3)))[0][:, 0]
        answers = solve_general_6r(arm, T)
        check_answers(arm, answers, T)


def test_parallel_and_coincident_neighbours_give_no_false_answer():
    for place in PLACES:
        for seed in range(8):
            rng = np.random.default_rng([seed, place])
            links = [
                link(rng.choice([0, np.pi / 2]), *rng.choice([0, 0.2], 2), rng.choice([0, np.pi / 2])) for _ in range(6)
            ]
            arm = arm_of(links, (place,), f"poor {place} {seed}")
            q = joints_of(arm, 4, seed)
            T = fk(arm, q)
            answers = solve_general_6r(arm, T)
            check_answers(arm, answers, T)
            assert (answers.valid.any(axis=1)).all()
            regular = np.linalg.svd(jacobian(arm, q), compute_uv=False)[:, -1] > 1e-3
            lost = apart(arm, answers.q, q[:, None]).min(axis=1) > 1e-5
            assert ((answers.flags[lost & regular] & Flag.doubtful) != 0).all()


def test_more_than_one_slide_is_refused():
    links = [link(0.3, 0.2, 0.1, 1.0)] * 6
    with pytest.raises(ArrayError, match=r"all revolute or one of them prismatic.*has 6 axes, 4 of them revolute"):
        prepare(arm_of(links, (1, 4), "two slides"))
