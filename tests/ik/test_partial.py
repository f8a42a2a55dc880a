"""Positions with one axis, and positions alone: isolated answers complete, families sampled, and the nearest of them exact.

Truth from outside: the textbook's product of exponentials, joints that made the target, Newton's method from many starts
by pseudo-inverse, and constrained minima by SciPy.
"""

from __future__ import annotations

import gc
import weakref
from functools import cache

import numpy as np
import pytest
from scipy.optimize import minimize

from pieper.errors import ArrayError
from pieper.ik.partial import PartialSolutions, covers, solve_partial
from pieper.ik.projection import project
from pieper.ik.target import Target, components, ignore_orientation, pose, position_and_axis, weight_orientation
from pieper.ik.virtual_joint import add_virtual_joints, complete_method
from pieper.kinematics.fk import fk
from pieper.model.chain import Chain
from tests.degenerate_arms import degenerate_arm
from tests.reference import product_of_exponentials as textbook
from tests.robots import ROBOTS, chain

ACCURACY = 1e-9  # [m and rad], what is promised
SAME = 1e-6  # [rad], joint values of one answer
BESIDE = 1e-5  # [rad], that for answers of badly conditioned targets
SKEW = (0.36, -0.48, 0.8)  # a tool axis that is no axis of any arm
SIX = tuple(robot.name for robot in ROBOTS if robot.dof == 6)
FIVE = (
    *(robot.name for robot in ROBOTS if robot.dof == 5),
    "mh12 locked",
    "mh12 locked askew",
    "ur5e with a stiff elbow",
)


@cache
def arm_of(name: str) -> Chain:
    if name == "mh12 locked":
        return chain("yaskawa_mh12", nominal=True).lock(joint_4_r=0.0)
    if name == "mh12 locked askew":
        return chain("yaskawa_mh12").lock(joint_4_r=0.5)
    if name == "ur5e with a stiff elbow":
        return chain("ur5e").lock(elbow_joint=0.4)
    if name.startswith("first three of "):
        arm = chain(name.removeprefix("first three of "))
        return arm.lock(**dict(zip(arm.joint_names[3:], (0.5, 0.2, 0.3), strict=True)))
    if name.startswith("without joints 3 and 6 of "):
        arm = chain(name.removeprefix("without joints 3 and 6 of "))
        return arm.lock(**{arm.joint_names[2]: 0.5, arm.joint_names[5]: 0.3})
    if name in TEXTBOOK:
        return textbook_arm(name)
    return chain(name)


THREE = tuple(
    f"first three of {name}" for name in ("ur5e", "abb_irb120", "fanuc_crx10ia", "puma560", "kuka_kr210_robond")
)
FOUR = tuple(f"without joints 3 and 6 of {name}" for name in ("ur5e", "abb_irb120", "fanuc_crx10ia"))
# name: turning (R) or sliding (P) joints, their directions and points, and how many answers a position has: 0 for a family
TEXTBOOK = {
    "planar 2R": ("RR", "zz", ((0, 0), (0.4, 0.1)), 2),
    "planar 3R": ("RRR", "zzz", ((0, 0), (0.3, 0.0), (0.5, 0.0)), 0),
    "SCARA 2RP": ("RRP", "zzz", ((0, 0), (0.4, 0.0), (0, 0)), 2),
    "SCARA 3RP": ("RRRP", "zzzz", ((0, 0), (0.4, 0.0), (0.65, 0.1), (0, 0)), 0),
    "gantry": ("PPP", "xyz", ((0, 0),) * 3, 1),
    "Stanford's first three": ("RRP", "zyx", ((0, 0), (0, 0.1), (0, 0)), 4),
}


def textbook_arm(name: str) -> Chain:
    pattern, directions, points, _ = TEXTBOOK[name]
    screws = []
    for kind, direction, point in zip(pattern, directions, points, strict=True):
        w = np.eye(3)["xyz".index(direction)]
        screws.append([*np.cross([*point, 0.0], w), *w] if kind == "R" else [*w, 0.0, 0.0, 0.0])
    home = np.eye(4)
    home[:3, 3] = [0.7, 0.1, 0.3]
    limits = [[-3.0, 3.0]] * len(pattern)
    return Chain(name, screws, home, limits, tuple(f"joint_{i + 1}" for i in range(len(pattern))))


def apart(arm: Chain, a, b):
    difference = np.asarray(a) - b
    turned = np.remainder(difference + np.pi, 2 * np.pi) - np.pi
    return np.abs(np.where(arm.is_revolute, turned, difference)).max(axis=-1)


def joints(arm: Chain, count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-np.pi, np.pi, (count, arm.dof))


def axis_target(T: np.ndarray, axis) -> Target:
    return position_and_axis(T[..., :3, 3], T[..., :3, :3] @ axis, axis_tip=axis)


def targets(arm: Chain, T: np.ndarray):
    """Every kind of target that the arm is covered for."""
    kinds = [ignore_orientation(T[..., :3, 3]), axis_target(T, (0.0, 0.0, 1.0)), axis_target(T, SKEW)]
    return [target for target in kinds if covers(arm, target)]


def check(arm: Chain, target: Target, answers: PartialSolutions, most: int = 12) -> None:
    """Errors are what the textbook measures, over the rows that count; empty places are NaN."""
    assert np.isnan(answers.q[~answers.valid]).all()
    assert np.isnan(answers.position_error[~answers.valid]).all()
    assert (answers.position_error[answers.valid] <= ACCURACY).all()
    assert (answers.rotation_error[answers.valid] <= ACCURACY).all()
    some = np.argwhere(answers.valid)
    for index in map(tuple, some[:: max(1, len(some) // most)]):
        T, wanted = textbook.fk(arm, answers.q[index]), target.T_base_tip[index[:-1]]
        away = np.linalg.norm(T[:3, 3] - wanted[:3, 3])
        assert abs(away - answers.position_error[index]) < 1e-12
        if target.axis is None:
            assert answers.rotation_error[index] == 0.0
        else:
            cross = np.cross(T[:3, :3] @ target.axis, wanted[:3, :3] @ target.axis)
            assert abs(np.linalg.norm(cross) - answers.rotation_error[index]) < 1e-12
            assert (T[:3, :3] @ target.axis) @ (wanted[:3, :3] @ target.axis) > 0.0


# Every arm


@pytest.mark.parametrize("name", [*SIX, *FIVE, *FOUR, *THREE, *TEXTBOOK])
def test_every_reachable_target_is_reached(name):
    arm = arm_of(name)
    T = fk(arm, joints(arm, 30, seed=0))
    kinds = targets(arm, T)
    assert kinds
    for target in kinds:
        answers = solve_partial(arm, target, samples=16)
        assert answers.valid.any(axis=-1).all(), answers.words
        check(arm, target, answers)
        lost = int("planar" in name) + int(
            answers.free_joint is not None and arm.dof == 5
        )  # rows that no joint moves along
        assert answers.free_dimension == arm.dof - (3 if target.axis is None else 5) + lost


@pytest.mark.parametrize("name", [*SIX, *FIVE, *FOUR, *THREE, *TEXTBOOK])
def test_with_a_seed_the_answer_is_no_farther_than_the_joints_that_made_the_target(name):
    arm = arm_of(name)
    q = joints(arm, 6, seed=1)
    seed = q + 0.2 * np.random.default_rng(2).normal(size=q.shape)
    for target in targets(arm, fk(arm, q)):
        answers = solve_partial(arm, target, seed=seed, samples=16)
        check(arm, target, answers)
        distance = np.linalg.norm(answers.q - seed[:, None], axis=-1)
        if answers.free_dimension == 0 and not answers.complete:
            continue  # a tool axis that is nearly the last joint axis
        assert (distance[:, 0] <= np.linalg.norm(q - seed, axis=-1) + 1e-9).all(), answers.words
        with np.errstate(invalid="ignore"):
            assert not (np.diff(distance, axis=-1) < -1e-12).any()
        turning = arm.is_revolute
        if answers.free_dimension == 0:  # of families, one may be a copy within limits that is farther away
            assert np.nanmax(np.abs(answers.q - seed[:, None])[..., turning], initial=0.0) <= np.pi + 1e-9


@pytest.mark.parametrize("name", [*FIVE, *THREE, *TEXTBOOK, "ur5e", "ur20", "abb_irb6640"])
def test_right_angles_and_stretched_arms(name):
    """Joints at multiples of 90 degrees, and a hair away: at the edge of reach families shrink to a point between the samples."""
    arm = arm_of(name)
    rng = np.random.default_rng(20)
    q = rng.integers(-1, 3, (12, arm.dof)) * (np.pi / 2)
    q[6:] += rng.choice([1e-3, 1e-6, 1e-9], size=(6, arm.dof)) * rng.normal(size=(6, arm.dof))
    for target in targets(arm, fk(arm, q)):
        answers = solve_partial(arm, target, samples=8)
        assert answers.valid.any(axis=-1).all(), answers.words
        check(arm, target, answers)


# Isolated answers


@pytest.mark.parametrize("name", FIVE)
def test_recall_of_a_position_and_an_axis_on_five_joints(name):
    arm = arm_of(name)
    q = joints(arm, 60 if "ur5e" in name or "askew" in name else 400, seed=3)  # not in closed form: projected slowly
    for axis in (SKEW, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)):
        target = axis_target(fk(arm, q), axis)
        answers = solve_partial(arm, target)
        if answers.free_joint is not None:
            q[:, answers.free_joint] = answers.q[:, 0, answers.free_joint]
        recalled = apart(arm, np.where(answers.valid[..., None], answers.q, 9.0), q[:, None]).min(axis=-1) < BESIDE
        if answers.complete:
            assert recalled.all(), (axis, answers.words)
        else:  # the course report's tool axis is 0.0005 from the last joint axis
            assert recalled.mean() > 0.9


@pytest.mark.parametrize("name", [*THREE, *(n for n in TEXTBOOK if TEXTBOOK[n][3])])
def test_recall_of_positions_on_three_joints(name):
    arm = arm_of(name)
    q = joints(arm, 400, seed=4)
    answers = solve_partial(arm, ignore_orientation(fk(arm, q)[:, :3, 3]))
    assert answers.complete
    assert answers.free_dimension == 0
    recalled = apart(arm, np.where(answers.valid[..., None], answers.q, 9.0), q[:, None]).min(axis=-1) < BESIDE
    assert recalled.all()
    if name in TEXTBOOK:
        assert (answers.valid.sum(axis=-1) == TEXTBOOK[name][3]).mean() > 0.9
        assert answers.valid.sum(axis=-1).max() == TEXTBOOK[name][3]


def newton_from_everywhere(arm: Chain, target: Target, starts: int, seed: int) -> np.ndarray:
    """(B, n) joint values that meet one target, by the pseudo-inverse from random starts."""
    q = joints(arm, starts, seed)
    wanted = target.T_base_tip
    axis = None if target.axis is None else np.array(target.axis)
    for _ in range(80):
        T, J = fk(arm, q), arm.native.jacobian(q)
        error, rows = wanted[:3, 3] - T[:, :3, 3], J[:, :3]
        if axis is not None:
            now = T[:, :3, :3] @ axis
            error = np.concatenate([error, wanted[:3, :3] @ axis - now], axis=-1)
            rows = np.concatenate([rows, np.cross(J[:, 3:], now[..., None], axis=1)], axis=1)
        step = (np.linalg.pinv(rows, rcond=1e-8) @ error[..., None])[..., 0]
        q = q + step * np.minimum(1.0, 0.4 / np.maximum(np.abs(step).max(axis=-1, keepdims=True), 1e-12))
    return q[np.abs(error).max(axis=-1) < 1e-10]


@pytest.mark.parametrize("name", [name for name in FIVE if name not in ("kuka_youbot", "mh12-report")])
def test_newton_from_many_starts_finds_nothing_else_on_five_joints(name):
    arm = arm_of(name)
    for index, T in enumerate(fk(arm, joints(arm, 4, seed=5))):
        target = axis_target(T, SKEW)
        answers = solve_partial(arm, target)
        others = newton_from_everywhere(arm, target, 150, seed=index)
        assert len(others) > 20
        listed = answers.q[answers.valid]
        assert (apart(arm, others[:, None], listed).min(axis=-1) < BESIDE).all()
        gaps = apart(arm, listed[:, None], listed) + 10.0 * np.eye(len(listed))
        assert gaps.min(initial=10.0) > SAME  # and none is listed twice


@pytest.mark.parametrize("name", THREE)
def test_newton_from_many_starts_finds_nothing_else_on_three_joints(name):
    arm = arm_of(name)
    for index, T in enumerate(fk(arm, joints(arm, 4, seed=6))):
        target = ignore_orientation(T[:3, 3])
        answers = solve_partial(arm, target)
        others = newton_from_everywhere(arm, target, 150, seed=index)
        listed = answers.q[answers.valid]
        assert len(others) > 20
        assert len(listed) <= 4
        assert (apart(arm, others[:, None], listed).min(axis=-1) < BESIDE).all()


# A free joint


@pytest.mark.parametrize("name", ["ur5e", "abb_irb120", "ufactory_xarm6", "kuka_youbot", "mh12 locked"])
def test_a_free_joint_moves_nothing_that_counts(name):
    arm = arm_of(name)
    target = axis_target(fk(arm, joints(arm, 10, seed=7)), (0.0, 0.0, 1.0))
    answers = solve_partial(arm, target)
    assert answers.free_joint == arm.dof - 1
    assert answers.free_dimension == 1
    assert answers.complete
    assert arm.joint_names[-1] in answers.words
    turned = answers.q.copy()
    turned[..., -1] += 1.234
    check(arm, target, answers._replace(q=turned))
    seeded = solve_partial(arm, target, seed=np.full(arm.dof, 0.321))
    assert (seeded.q[seeded.valid][:, -1] == 0.321).all()


def test_an_axis_out_of_the_plane_of_the_arm_leaves_its_angle():
    """Four joints are left for five rows; what is left is the angle to the plane, computed here from the first joint alone."""
    arm = chain("kuka_youbot")
    q = np.array([2.0, 1.3, -1.9, 2.4, 1.0])
    p, approach = fk(arm, q)[:3, 3], fk(arm, q)[:3, 2]
    first = textbook.exponential(arm.screws[0], q[0])[:3, :3]
    normal = first @ arm.screws[1, 3:]
    wanted = np.cos(0.2) * approach + np.sin(0.2) * normal
    answers = solve_partial(arm, position_and_axis(p, wanted))
    assert not answers.valid.any()
    assert answers.nearest is not None
    assert abs(answers.nearest.rotation_error[0] - 0.2) < 1e-12
    assert np.abs(fk(arm, answers.nearest.q[0])[:3, 3] - p).max() < 1e-12
    assert abs(fk(arm, answers.nearest.q[0])[:3, 2] @ normal) < 1e-12
    within = solve_partial(arm, position_and_axis(p, wanted), rotation_tolerance=0.21)
    assert within.valid.any()
    assert within.rotation_error[within.valid].max() <= 0.21
    assert np.isnan(within.nearest.q).all()


# Families


@pytest.mark.parametrize("name", ["ur5e", "fanuc_crx10ia", "kuka_kr210_robond", "kuka_youbot", *FOUR[:1]])
def test_scipy_finds_nothing_nearer_to_a_seed(name):
    arm = arm_of(name)
    q = joints(arm, 2, seed=8)
    seeds = q + 0.5 * np.random.default_rng(9).normal(size=q.shape)
    for T, seed in zip(fk(arm, q), seeds, strict=True):
        for target in targets(arm, T):
            answers = solve_partial(arm, target, seed=seed)
            if answers.free_dimension == 0 or answers.free_joint is not None:
                continue
            ours = np.linalg.norm(answers.q[0] - seed)
            axis = None if target.axis is None else np.array(target.axis)

            def left(x, T=T, axis=axis):
                now = fk(arm, x)
                error = [now[:3, 3] - T[:3, 3]]
                if axis is not None:
                    across = np.linalg.svd((T[:3, :3] @ axis)[None])[2][1:]
                    error.append(across @ now[:3, :3] @ axis)
                return np.concatenate(error)

            best = np.inf
            for start in (seed, answers.q[0], answers.q[1]):
                result = minimize(
                    lambda x, seed=seed: 0.5 * float((x - seed) @ (x - seed)),
                    start,
                    jac=lambda x, seed=seed: x - seed,
                    constraints={"type": "eq", "fun": left},
                    method="SLSQP",
                    options={"maxiter": 200},
                )
                if np.abs(left(result.x)).max() < 1e-6:
                    best = min(best, float(np.linalg.norm(result.x - seed)))
            assert ours <= best + 1e-5


@pytest.mark.parametrize("name", ["ur5e", "fanuc_crx10ia", "so101", *FOUR[:1], "SCARA 3RP"])
def test_the_way_to_the_seed_is_across_the_family(name):
    """At the nearest answer the way to the seed has no part along the null space of the rows (finite differences of the textbook)."""
    arm = arm_of(name)
    q = joints(arm, 3, seed=10)
    seeds = q + 0.3 * np.random.default_rng(11).normal(size=q.shape)
    for target in targets(arm, fk(arm, q)):
        answers = solve_partial(arm, target, seed=seeds)
        if answers.free_dimension == 0 or answers.free_joint is not None:
            continue
        for one, seed in enumerate(seeds):

            def rows(x, target=target):
                T = textbook.fk(arm, x)
                return T[:3, 3] if target.axis is None else np.append(T[:3, 3], T[:3, :3] @ target.axis)

            nearest = answers.q[one, 0]
            J = np.stack([(rows(nearest + d) - rows(nearest - d)) / 2e-6 for d in 1e-6 * np.eye(arm.dof)], axis=-1)
            _, sizes, V = np.linalg.svd(J)
            null = V[int((sizes > 1e-6).sum()) :]
            assert len(null) == answers.free_dimension
            assert np.abs(null @ (nearest - seed)).max() < 1e-6


def test_samples_are_spread_around_the_axis():
    arm = chain("fanuc_crx10ia")
    target = axis_target(fk(arm, [0.1, -0.4, 0.3, 0.5, 0.9, -0.2]), SKEW)
    T = target.T_base_tip
    answers = solve_partial(arm, target, samples=24)
    assert not answers.complete
    R = fk(arm, answers.q[answers.valid])[:, :3, :3]
    across = np.array([0.8, 0.6, 0.0])
    turns = np.arctan2((R @ across) @ (T[:3, :3] @ np.cross(SKEW, across)), (R @ across) @ (T[:3, :3] @ across))
    steps = np.unique(np.round(np.remainder(turns / (2 * np.pi / 24) + 1e-6, 24)).astype(int) % 24)
    assert len(steps) > 3
    np.testing.assert_allclose(np.sin(12 * turns), 0.0, atol=1e-6)


@pytest.mark.parametrize("name", ["ur5e", "fanuc_crx10ia", "kuka_youbot"])
def test_one_answer_is_near_the_seed_and_within_limits(name):
    """Where the nearest of all breaks a limit, another one goes along the family until a joint is at its limit."""
    arm = arm_of(name)
    rng = np.random.default_rng(12)
    middle = np.clip(arm.limits, -np.pi, np.pi).mean(axis=1)
    limits = np.stack([middle - 1.2, middle + 1.2], axis=-1)
    narrow = Chain(arm.name, arm.screws, arm.home, limits, arm.joint_names)
    q = rng.uniform(*limits.T, (20, arm.dof))
    seeds = np.clip(q + 0.6 * rng.normal(size=q.shape), *limits.T)

    def nearest_inside(answers):
        inside = answers.valid & ((answers.q >= limits[:, 0]) & (answers.q <= limits[:, 1])).all(axis=-1)
        distance = np.linalg.norm(answers.q - seeds[:, None], axis=-1)
        return np.where(inside, distance, np.inf).argmin(axis=-1), np.where(inside, distance, np.inf).min(axis=-1)

    for target in targets(arm, fk(arm, q)):
        answers = solve_partial(narrow, target, seed=seeds)
        if answers.free_dimension == 0 or answers.free_joint is not None:
            continue
        place, distance = nearest_inside(answers)
        _, sampled = nearest_inside(solve_partial(narrow, target, samples=400))
        # a least value among those within limits is a local one: now and then a sample of another branch is nearer
        assert (distance <= sampled + 1e-9).mean() >= 0.9
        assert (distance <= np.linalg.norm(q - seeds, axis=-1) + 1e-9).mean() >= 0.9
        best = answers.q[np.arange(20), place]
        at_limit = np.isfinite(distance) & (np.minimum(best - limits[:, 0], limits[:, 1] - best) == 0.0).any(axis=-1)
        assert at_limit.any()


def test_small_families_between_the_samples_are_found():
    """Nearly out of reach the turn about the axis has little room: fewer than one sample in three meets it."""
    arm = chain("fanuc_crx10ia")
    T = fk(arm, joints(arm, 300, seed=13))
    answers = solve_partial(arm, axis_target(T, (0.0, 0.0, 1.0)), samples=3)
    assert answers.valid.any(axis=-1).all()


@pytest.mark.parametrize("number", range(25))
def test_arms_that_no_one_would_build(number):
    """Axes that coincide or nearly so: no crash, no false answer, and the targets of the arm itself are reached."""
    rng = np.random.default_rng(number)
    count = int(rng.integers(2, 7))
    arm = degenerate_arm(
        lambda k: int(rng.integers(k)), lambda: float(rng.uniform(-1, 1)), count, slides=bool(rng.integers(2))
    )
    q = rng.uniform(-3, 3, (2, count))
    T = fk(arm, q)
    for target in targets(arm, T):
        for seed in (None, q + 0.1):
            answers = solve_partial(arm, target, samples=8, seed=seed)
            check(arm, target, answers)
            assert answers.valid.any(axis=-1).all()
    if count == 5:
        found = project(arm, T)
        assert (found.rotation_error[:, 0] < 1e-5).all()  # flat where joints hardly turn the tip
        assert (found.position_error[:, 0] < 1e-9).all()


# Out of reach, shapes, input


@pytest.mark.parametrize("name", ["ur5e", "fanuc_crx10ia", "so101", "kuka_youbot", *FOUR[:1], *THREE[:1], *TEXTBOOK])
def test_out_of_reach_there_is_no_answer(name):
    arm = arm_of(name)
    T = fk(arm, joints(arm, 3, seed=14))
    T[:, :3, 3] += np.array([30.0, 20.0, 10.0])
    if name == "gantry":
        return  # reaches everywhere
    for target in targets(arm, T):
        if name.startswith("SCARA") or "Stanford" in name:
            target.T_base_tip[:, 2, 3] -= 10.0
        if "Stanford" in name:
            continue  # and so does a slide on a turret
        answers = solve_partial(arm, target, samples=8)
        assert not answers.valid.any()
        assert np.isnan(answers.q).all()
        if answers.nearest is not None:
            assert (answers.nearest.out_of_reach > 30.0).all()
        assert not solve_partial(arm, target, seed=np.zeros(arm.dof), samples=8).valid.any()


@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2), (0,)])
@pytest.mark.parametrize("name", ["ur5e", "so101", "kuka_youbot", "mh12-report", *FOUR[:1], *THREE[:1]])
def test_batch_shapes(name, shape):
    arm = arm_of(name)
    T = fk(arm, joints(arm, int(np.prod(shape)), seed=15).reshape(*shape, arm.dof))
    for target in targets(arm, T):
        for seed in (None, np.zeros(arm.dof)):
            answers = solve_partial(arm, target, seed=seed, samples=4)
            k = answers.q.shape[-2]
            assert answers.q.shape == (*shape, k, arm.dof)
            assert answers.valid.shape == answers.position_error.shape == answers.rotation_error.shape == (*shape, k)
            if answers.nearest is not None:
                assert answers.nearest.q.shape == (*shape, 8, 5)
                assert answers.nearest.out_of_reach.shape == shape


@pytest.mark.parametrize("name", ["ur5e", "so101", "kuka_youbot", *FOUR[:1]])
def test_a_batch_equals_its_parts_on_any_number_of_threads(name):
    arm = arm_of(name)
    T = fk(arm, joints(arm, 4, seed=16))
    seeds = joints(arm, 4, seed=17)
    for together_target, of in zip(targets(arm, T), zip(*(targets(arm, one) for one in T), strict=True), strict=True):
        together = solve_partial(arm, together_target, seed=seeds, samples=8, threads=2)
        for one, (target, seed) in enumerate(zip(of, seeds, strict=True)):
            alone = solve_partial(arm, target, seed=seed, samples=8)
            count = int(alone.valid.sum())
            assert count == together.valid[one].sum()
            np.testing.assert_allclose(alone.q[:count], together.q[one, :count], atol=1e-6)


def test_chunks_are_joined(monkeypatch):
    arm = chain("ur5e")
    target = axis_target(fk(arm, joints(arm, 7, seed=18)), SKEW)
    whole = solve_partial(arm, target, samples=8)
    monkeypatch.setattr("pieper.ik.partial._AT_ONCE", 24)
    chunked = solve_partial(arm, target, samples=8)
    assert (whole.valid == chunked.valid).all()
    np.testing.assert_allclose(whole.q, chunked.q, atol=1e-9)


def test_what_is_not_covered():
    arm = chain("ur5e")
    T = fk(arm, np.full(6, 0.3))
    for target in (
        pose(T),
        weight_orientation(T, 0.1),
        components(T, "x y rz"),
        components(T, "x y z rz"),
        components(T, "x y"),
        Target(T, weights=(2.0, 1.0, 1.0, 0.0, 0.0, 0.0)),
        Target(T, weights=(1.0, 1.0, 1.0, 0.5, 0.5, 0.5), axis=(0.0, 0.0, 1.0)),
    ):
        assert not covers(arm, target)
        with pytest.raises(
            ArrayError, match=r"solve_partial does not cover this target of 'ur5e' with 6 joints: .* numeric solver"
        ):
            solve_partial(arm, target)
    assert not covers(chain("franka_panda"), ignore_orientation(T[:3, 3]))
    assert not covers(arm_of(FOUR[0]), position_and_axis(T[:3, 3], [0.0, 0.0, 1.0]))
    assert covers(arm, components(T, "x y z"))  # the same rows by another name
    # the tip of a Puma is where its wrist axes meet: with one of the first three joints held two are left for the position
    puma = chain("puma560")
    assert not covers(puma.lock(**{puma.joint_names[2]: 0.3}), ignore_orientation(T[:3, 3]))


def test_mimic_joints_are_not_covered():
    arm = chain("so101")
    coupling = np.vstack([np.eye(4), [0.0, 0.0, 0.0, 1.0]])
    coupled = Chain("coupled", arm.screws, arm.home, arm.limits[:4], arm.joint_names[:4], coupling=coupling)
    assert not covers(coupled, ignore_orientation([0.1, 0.1, 0.1]))
    with pytest.raises(ArrayError, match="virtual joints are for chains without mimic joints; 'coupled' has some"):
        add_virtual_joints(coupled, [[0.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"seed": [0.0, 1.0]}, r"seed must have shape \(\.\.\., 6\), got \(2,\)"),
        ({"seed": np.full(6, np.nan)}, "seed must be finite"),
        ({"seed": np.zeros((2, 6))}, r"seed must have leading axes that broadcast to \(\), got shape \(2, 6\)"),
        ({"samples": 0}, "samples must be a whole number of at least 1, got 0"),
        ({"samples": 2.5}, "samples must be a whole number of at least 1, got 2.5"),
        ({"threads": 0}, "threads must be a whole number of at least 1, got 0"),
        ({"position_tolerance": 0.0}, "position_tolerance must be a positive number, got 0.0"),
        ({"rotation_tolerance": "small"}, "rotation_tolerance must be a positive number, got 'small'"),
    ],
)
def test_bad_input(options, message):
    with pytest.raises(ArrayError, match=message):
        solve_partial(chain("ur5e"), ignore_orientation([0.3, 0.3, 0.3]), **options)


# Virtual joints


def test_virtual_joints_turn_the_tip_about_itself():
    arm = chain("so101")
    longer = add_virtual_joints(arm, [[0.0, 0.0, 2.0], [1.0, 0.0, 0.0]])
    assert longer.joint_names == (*arm.joint_names, "virtual_1", "virtual_2")
    rng = np.random.default_rng(19)
    for _ in range(10):
        q = rng.uniform(-3, 3, 7)
        T, short = textbook.fk(longer, q), textbook.fk(arm, q[:5])
        np.testing.assert_allclose(T[:3, 3], short[:3, 3], atol=1e-14)
        q[6] = 0.0
        np.testing.assert_allclose(textbook.fk(longer, q)[:3, 2], short[:3, 2], atol=1e-14)
    again = add_virtual_joints(longer, [[0.0, 1.0, 0.0]])
    assert again.joint_names[-1] == "virtual_1_2"


@pytest.mark.parametrize(
    ("axes", "message"),
    [
        ([0.0, 0.0, 1.0], r"shape \(m, 3\), got \(3,\)"),
        ([[0.0, 0.0, 0.0]], "have a direction"),
        ([[np.nan, 0, 1]], "finite"),
    ],
)
def test_virtual_axes_are_checked(axes, message):
    with pytest.raises(ArrayError, match=message):
        add_virtual_joints(chain("so101"), axes)


def test_there_is_no_complete_method_for_seven_joints():
    assert complete_method(chain("franka_panda")) is None
    assert "general" in complete_method(chain("ufactory_xarm6")).words


def test_what_is_kept_for_a_chain_goes_with_it():
    arm = chain("ur5e").with_tool(np.eye(4))
    solve_partial(arm, ignore_orientation([0.3, 0.3, 0.3]), samples=2)
    five = arm.lock(elbow_joint=0.4)
    solve_partial(five, position_and_axis([0.3, 0.3, 0.3], SKEW, axis_tip=SKEW))
    gone = [weakref.ref(arm), weakref.ref(five)]
    del arm, five
    gc.collect()
    assert [one() for one in gone] == [None, None]
