"""Seven joints: every solution for a value, the curves of all solutions, the nearest one, branches, bad input."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.optimize import minimize

from pieper.errors import ArrayError, UnknownNameError
from pieper.ik.numeric import solve_numeric
from pieper.ik.redundancy import (
    nearest_on_self_motion,
    prepare,
    self_motion,
    solve_redundant,
    track_branches,
)
from pieper.kinematics.fk import fk
from pieper.model.chain import Chain
from tests.reference import product_of_exponentials as reference
from tests.robots import ROBOTS, chain

SEVEN = tuple(robot.name for robot in ROBOTS if robot.dof == 7)
OTHERS = ("offset arm", "UR5e on a rail")
ACCURACY = 1e-9  # [m, rad] of every answer
SAME = 1e-6  # rad: what rounding leaves of joints at random poses
CLOSED = {name: name != "kinova_gen3_7dof" for name in SEVEN}  # 12 mm keep the Gen3 from a closed form


@cache
def arm_of(name):
    if name == "offset arm":  # alternating axes, each set off sideways, as on arms with seven equal joint modules
        points = [
            (0, 0, 0.2), (0.03, -0.07, 0.31), (0, 0.02, 0.5), (0.04, 0.08, 0.62), (0.01, -0.03, 0.8), (0, 0.06, 0.92),
            (0.07, 0, 1),
        ]  # fmt: skip
        screws = []
        for i, p in enumerate(points):
            w = np.array([0.0, 1.0, 0.0] if i % 2 else [0.0, 0.0, 1.0])
            screws.append(np.concatenate([np.cross(p, w), w]))
        home = np.eye(4)
        home[:3, 3] = (0.07, 0.0, 1.1)
        return Chain(name, screws, home, [[-np.pi, np.pi]] * 7, [f"joint_{i}" for i in range(1, 8)])
    if name == "UR5e on a rail":
        six = chain("ur5e")
        screws = np.vstack([[0.0, 1.0, 0.0, 0.0, 0.0, 0.0], six.screws])
        return Chain(name, screws, six.home, [[-1.0, 1.0], *six.limits], ["rail", *six.joint_names])
    return chain(name)


def joints(arm, count, seed=0):
    """Random joint values; those of the joint that is held are within its limits."""
    held = prepare(arm).joint
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (count, 7))
    lower, upper = np.clip(arm.limits[held], -np.pi, np.pi)
    q[:, held] = np.random.default_rng(seed + 1).uniform(lower, upper, count)
    return q


def wrapped(arm, q):
    return np.where(arm.is_revolute, (q + np.pi) % (2.0 * np.pi) - np.pi, q)


def apart(arm, q, wanted):
    distance = np.abs(wrapped(arm, q - wanted)).max(axis=-1)
    return np.where(np.isnan(distance), np.inf, distance)


def errors(arm, q, T):
    return max(np.abs(reference.fk(arm, row) - T).max() for row in q)


@pytest.mark.parametrize("name", [*SEVEN, *OTHERS])
def test_generating_joints_are_among_the_answers(name):
    arm = arm_of(name)
    q = joints(arm, 200)
    answers = solve_redundant(arm, fk(arm, q), values=q[:, [prepare(arm).joint]])
    assert apart(arm, answers.q, q[:, None]).min(axis=1).max() < SAME
    assert np.nanmax(answers.position_error) < ACCURACY
    assert np.nanmax(answers.rotation_error) < ACCURACY
    assert np.isnan(answers.q[~answers.valid]).all()
    assert np.isnan(answers.position_error[~answers.valid]).all()
    assert (
        answers.doubtful.mean() < 0.01
    )  # the general solver, asked where a rounded closed form has doubts, may keep some


@pytest.mark.parametrize("name", [*SEVEN, *OTHERS])
def test_errors_are_those_of_the_whole_arm(name):
    arm = arm_of(name).with_tool(tool())
    q = joints(arm, 1)[0]
    T = reference.fk(arm, q)
    answers = solve_redundant(arm, T)
    held = prepare(arm).joint
    assert answers.valid.any()
    for row, value in zip(answers.q[answers.valid][::5], answers.value[answers.valid][::5], strict=True):
        assert np.abs(reference.fk(arm, row) - T).max() < ACCURACY
        assert row[held] == value
    lower, upper = arm.limits[held]
    assert ((answers.value >= lower) & (answers.value <= upper)).all()
    assert len(np.unique(answers.value)) == 16


def tool():
    T = np.eye(4)
    T[:3, :3] = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    T[:3, 3] = [0.1, -0.05, 0.2]
    return T


@pytest.mark.parametrize("name", [*SEVEN, *OTHERS])
def test_nothing_is_missing_that_iteration_finds(name):
    arm = arm_of(name)
    held = prepare(arm).joint
    q = joints(arm, 2, seed=5)
    for row, T in zip(q, fk(arm, q), strict=True):
        answers = solve_redundant(arm, T, values=row[held])
        free = arm.lock(**{arm.joint_names[held]: row[held]})
        free = Chain(free.name, free.screws, free.home, np.tile([-np.pi, np.pi], (6, 1)), free.joint_names)
        found = solve_numeric(free, T, count=24, restarts=400)
        for other in found.q[found.valid]:
            assert apart(arm, answers.q, np.insert(other, held, row[held])).min() < 1e-4


@pytest.mark.parametrize("name", ["franka_panda", "ufactory_xarm7", "offset arm"])
def test_an_inner_joint_is_held_by_name(name):
    arm = arm_of(name)
    q = joints(arm, 3, seed=2)
    T = fk(arm, q)
    for joint in (1, 3, 6):
        inside = np.clip(q, *np.clip(arm.limits, -np.pi, np.pi).T)
        T = fk(arm, inside)
        answers = solve_redundant(arm, T, values={arm.joint_names[joint]: inside[:, [joint]]})
        assert apart(arm, answers.q, inside[:, None]).min(axis=1).max() < SAME
        assert np.nanmax(answers.position_error) < ACCURACY


@pytest.mark.parametrize("name", ["franka_panda", "kuka_iiwa14_ros_industrial", "kinova_gen3_7dof", "ufactory_xarm7"])
def test_a_batch_is_its_parts(name):
    arm = arm_of(name)
    q = joints(arm, 6).reshape(3, 1, 2, 7)
    T = fk(arm, q)
    answers = solve_redundant(arm, T, samples=5)
    places = prepare(arm).places
    assert answers.q.shape == (3, 1, 2, 5 * places, 7)
    assert answers.valid.shape == answers.value.shape == answers.position_error.shape == (3, 1, 2, 5 * places)
    assert answers.doubtful.shape == (3, 1, 2, 5)
    threaded = solve_redundant(arm, T, samples=5, threads=2)
    for index in np.ndindex(3, 1, 2):
        one = solve_redundant(arm, T[index], samples=5)
        for batch, alone, other in zip(answers, one, threaded, strict=True):
            assert np.array_equal(batch[index], alone, equal_nan=batch.dtype == float)
            assert np.array_equal(other[index], alone, equal_nan=batch.dtype == float)
    assert solve_redundant(arm, T[:, 0, 0].tolist(), samples=2).q.shape == (3, 2 * places, 7)
    assert solve_redundant(arm, T[:0, 0, 0]).q.shape == (0, 16 * places, 7)


def test_what_was_found_is_said():
    for name in SEVEN:
        redundancy = prepare(chain(name))
        assert redundancy.family.has_closed_form == CLOSED[name]
        assert redundancy.joint in (0, 6)
        assert redundancy.reason.startswith(f"{redundancy.joint_name} is given; of the other six, ")
        assert ("closed form" in redundancy.reason) != CLOSED[name]
        assert prepare(chain(name)) is redundancy
    assert "swivel angle" in prepare(chain("kuka_iiwa14")).reason
    assert prepare(arm_of("UR5e on a rail")).joint_name == "rail"
    assert prepare(chain("franka_panda")).family.reversed


def test_samples_are_in_the_middle_of_equal_parts():
    panda = prepare(chain("franka_panda"))
    lower, upper = panda.chain.limits[panda.joint]
    assert np.allclose(panda.samples(4), lower + (upper - lower) * np.array([1, 3, 5, 7]) / 8)
    assert np.allclose(panda.samples(4, limited=False), np.pi * np.array([-3, -1, 1, 3]) / 4)
    gen3 = prepare(chain("kinova_gen3_7dof"))
    assert np.allclose(gen3.samples(2), [-np.pi / 2, np.pi / 2])


@pytest.mark.parametrize("name", [*SEVEN, "offset arm"])
def test_out_of_reach(name):
    arm = arm_of(name)
    T = np.eye(4)
    T[:3, 3] = [3.0, 0.0, 0.4]
    assert not solve_redundant(arm, T).valid.any()
    assert self_motion(arm, T) == []
    point = nearest_on_self_motion(arm, T, np.zeros(7))
    assert np.isinf(point.distance)
    assert np.isnan(point.q).all()


# Self-motion.


@cache
def motion(name, seed):
    arm = arm_of(name)
    q = joints(arm, 1, seed)[0]
    T = fk(arm, q)
    return arm, q, T, self_motion(arm, T)


@pytest.mark.parametrize("name", [*SEVEN, *OTHERS])
@pytest.mark.parametrize("seed", [0, 3])
def test_every_solution_is_on_one_curve(name, seed):
    arm, q, T, curves = motion(name, seed)
    for curve in curves:
        assert curve.closed or curve.ends == "beyond the limit of rail"
        assert errors(arm, curve.q[:: len(curve.q) // 5], T) < 1e-10
    # the joints that made the pose, answers for other values, and what iteration finds in the whole joint space
    limits = np.where(arm.is_revolute[:, None], [-4.0, 4.0], arm.limits)
    free = Chain(arm.name, arm.screws, arm.home, limits, arm.joint_names)
    found = solve_numeric(free, T, count=400, restarts=1000)
    sampled = solve_redundant(arm, T, samples=23)
    for others in (q[None], sampled.q[sampled.valid], found.q[found.valid]):
        on = np.array([curve.contains(others, tolerance=1e-5) for curve in curves])
        assert (on.sum(axis=0) == 1).all()


def test_curves_that_cross_are_found_though_no_sampled_value_is_on_them():
    # joint 2 at 0: joints 1 and 3 turn against each other, and joint 7, which is sampled, stays
    for name in ("kuka_iiwa14", "franka_panda"):
        arm = chain(name)
        q = np.array([0.1, 0.0, 0.3, -0.9, 0.4, 0.5, 0.6])
        curves = self_motion(arm, fk(arm, q))
        assert sum(bool(curve.contains(q)) for curve in curves) == 1
        assert sum(bool(curve.coupling) for curve in curves) >= 1


def test_a_straight_arm_moves_too():
    arm = chain("kuka_iiwa14")
    q = np.array([0.1, 0.2, 0.3, 0.0, 0.4, 0.5, 0.6])
    curves = self_motion(arm, fk(arm, q))
    assert curves
    assert any(curve.contains(q, tolerance=1e-5) for curve in curves)
    assert all(curve.coupling.startswith("lbr_A3 ") for curve in curves)


# The nearest solution.


@pytest.mark.parametrize("name", [*SEVEN, *OTHERS])
def test_the_nearest_solution_is_nearer_than_any_sampled_one(name):
    arm = arm_of(name)
    lower, upper = arm.limits.T
    middle = np.where(np.isfinite(arm.limits), arm.limits, 0.0).mean(axis=1)
    rng = np.random.default_rng(6)
    T = fk(arm, middle + rng.uniform(-0.6, 0.6, 7) * np.where(arm.is_revolute, 1.0, 0.5))
    seed = middle + rng.uniform(-1.0, 1.0, 7)
    answers = solve_redundant(arm, T, samples=2000)
    q = answers.q[answers.valid]
    copies = q + np.where(arm.is_revolute, 2.0 * np.pi, 0.0) * np.arange(-2, 3)[:, None, None]
    far = np.abs(copies - seed)
    anywhere = np.linalg.norm(far.min(axis=0), axis=-1)
    inside = np.linalg.norm(np.where((copies >= lower) & (copies <= upper), far, np.inf).min(axis=0), axis=-1)
    for distance, limited in ((anywhere, False), (inside, True)):
        point = nearest_on_self_motion(arm, T, seed, within_limits=limited)
        assert point.distance <= distance.min() + 1e-9
        assert point.distance >= distance.min() - 0.02  # 2000 values are 0.003 rad apart
        assert np.linalg.norm(point.q - seed) == pytest.approx(point.distance, abs=1e-9)
        assert np.abs(reference.fk(arm, point.q) - T).max() < ACCURACY
        if limited:
            assert ((point.q >= lower) & (point.q <= upper)).all()
        else:
            better = minimize(
                lambda x: ((x - seed) ** 2).sum(),
                point.q,
                constraints={"type": "eq", "fun": lambda x: (fk(arm, x) - T)[:3].ravel()[[3, 7, 11, 1, 2, 6]]},
                method="SLSQP",
                options={"ftol": 1e-14},
            )
            assert better.fun >= point.distance**2 - 1e-6


def test_joints_that_solve_it_are_their_own_nearest():
    arm = chain("kuka_iiwa14")
    for q in ([0.1, 0.4, 0.3, -1.0, 0.4, 0.5, 0.6], [0.1, 0.0, 0.3, -0.9, 0.4, 0.5, 0.6]):
        point = nearest_on_self_motion(arm, fk(arm, q), q)
        assert point.distance < 1e-8


# Branches.


@pytest.mark.parametrize("name", [*SEVEN, "offset arm"])
def test_branches_follow_the_value_without_turning_back(name):
    arm, _, T, curves = motion(name, 0)
    held = prepare(arm).joint
    answers = solve_redundant(arm, T, samples=12)
    branch = track_branches(answers, curves)
    assert ((branch >= 0) == answers.valid).all()
    values = np.unique(answers.value)
    for number in range(branch.max() + 1):
        own = np.flatnonzero(branch == number)
        assert len(np.unique(answers.value[own])) == len(own)
        (curve,) = (c for c in curves if c.contains(answers.q[own[0]]))
        places = curve.place(answers.q[own])
        broken = 0
        for i in range(len(own)):
            start, end = places[i], places[(i + 1) % len(own)]
            rises = False  # one way along the curve the value rises all the time, to the next value
            for x, y in ((start, end), (start, end + curve.length), (start + curve.length, end)):
                moved = curve.at(np.linspace(x, y, 100))[:, held]
                rises |= bool((np.diff(moved) > 0.0).all()) and moved[-1] - moved[0] < 1.001 * (values[1] - values[0])
            broken += not rises
        assert broken <= 1  # from its last value to its first


def test_neighbours_on_a_curve_without_a_fold_share_a_branch():
    arm, _, T, curves = motion("franka_panda", 0)
    answers = solve_redundant(arm, T, samples=12)
    branch = track_branches(answers, curves)
    held = prepare(arm).joint
    values = np.unique(answers.value)
    folds = sum(int((c.tangents[:-1, held] * c.tangents[1:, held] < 0.0).sum()) for c in curves)
    assert branch.max() + 1 <= folds + 2 * len(curves)
    for curve in curves:  # Newton's method with the value raised in small steps ends at the answer of the same branch
        at = np.flatnonzero(answers.valid)
        at = at[curve.contains(answers.q[at])]
        for a in at[::7]:
            q = answers.q[a].copy()
            i = int(np.searchsorted(values, answers.value[a]))
            if i + 1 == len(values):
                continue
            t = np.inf
            for value in np.linspace(values[i], values[i + 1], 60)[1:]:
                q[held] = value
                for _ in range(8):
                    now = fk(arm, q)
                    left = np.concatenate([T[:3, 3] - now[:3, 3], axis_of(T[:3, :3] @ now[:3, :3].T)])
                    J = np.delete(arm.native.jacobian(q), held, axis=1)
                    step = np.linalg.solve(J, left)
                    t = np.abs(step).max()
                    q += np.insert(step, held, 0.0)
                    if t < 1e-12 or t > 0.2:
                        break
                if t > 1e-6:
                    break
            if t > 1e-6:
                continue  # a fold
            to = int(np.argmin(apart(arm, answers.q, q)))
            assert apart(arm, answers.q[to], q) < SAME
            assert branch[to] == branch[a]


def axis_of(R):
    return 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])


def test_no_branches_without_answers():
    arm = chain("franka_panda")
    T = np.eye(4)
    T[0, 3] = 3.0
    assert (track_branches(solve_redundant(arm, T), []) == -1).all()


# What is refused.


def test_bad_input():
    arm = chain("franka_panda")
    T = fk(arm, [0.1, -0.5, 0.2, -2.0, 0.3, 1.6, 0.7])
    with pytest.raises(
        ArrayError, match=r"values of 'panda_joint7' must be within its limits, -2\.8973 to 2\.8973, got 3"
    ):
        solve_redundant(arm, T, values=[0.1, 3.0])
    with pytest.raises(ArrayError, match=r"values of 'panda_joint4' must be within its limits, .* got 0\.5"):
        solve_redundant(arm, T, values={"panda_joint4": 0.5})
    with pytest.raises(UnknownNameError, match="no joint 'elbow'"):
        solve_redundant(arm, T, values={"elbow": 0.5})
    with pytest.raises(ArrayError, match="values must name one joint or 'swivel', got 2 names"):
        solve_redundant(arm, T, values={"panda_joint4": -0.5, "panda_joint7": 0.1})
    with pytest.raises(ArrayError, match="values must be finite"):
        solve_redundant(arm, T, values=[0.1, np.nan])
    with pytest.raises(ArrayError, match="samples must be a whole number of at least 1, got 0"):
        solve_redundant(arm, T, samples=0)
    with pytest.raises(ArrayError, match="samples must be a whole number"):
        self_motion(arm, T, samples=1.5)
    with pytest.raises(ArrayError, match="threads must be a whole number"):
        solve_redundant(arm, T, threads=0)
    for wrong in (T[:3], np.full((4, 4), np.nan), T * 2.0, T + 1e-6, "pose", [[T, T], [T]]):
        with pytest.raises(ArrayError, match="T_base_tip"):
            solve_redundant(arm, wrong)
        with pytest.raises(ArrayError, match="T_base_tip"):
            self_motion(arm, wrong)
    bad = np.stack([T, T])
    bad[1, 0, 0] = np.inf
    with pytest.raises(ArrayError, match=r"T_base_tip must be finite, got inf at index \(1, 0, 0\)"):
        solve_redundant(arm, bad)
    bad[1] = T
    bad[1, :3, :3] *= 1.1
    with pytest.raises(ArrayError, match=r"rotation block of T_base_tip .* at index \(1,\)"):
        solve_redundant(arm, bad)
    with pytest.raises(ArrayError, match="self-motion is that of one pose"):
        self_motion(arm, np.stack([T, T]))
    with pytest.raises(ArrayError, match="also must have shape"):
        nearest_on_self_motion(arm, T, [0.0, 1.0])
    with pytest.raises(ArrayError, match="branches are those of one pose"):
        track_branches(solve_redundant(arm, np.stack([T, T])), [])
    iiwa = chain("kuka_iiwa14")
    T = fk(iiwa, [0.1, 0.5, 0.2, -1.2, 0.3, 0.9, 0.4])
    with pytest.raises(ArrayError, match=r"values of one joint.*solve with `samples`, or name a joint"):
        track_branches(solve_redundant(iiwa, T, values={"swivel": [0.123, 0.456]}), [])


def test_other_arms_are_refused():
    with pytest.raises(ArrayError, match=r"redundancy is that of seven joints; 'ur5e' has 6$"):
        solve_redundant(chain("ur5e"), np.eye(4))
    arm = chain("franka_panda")
    longer = Chain(
        "eight", np.vstack([arm.screws, arm.screws[0]]), arm.home, np.tile([-1.0, 1.0], (8, 1)), [*"abcdefgh"]
    )
    with pytest.raises(ArrayError, match="has 8; lock all but seven first, or use the numeric solver"):
        prepare(longer)
    coupling = np.eye(7)[[0, 1, 2, 3, 4, 5, 6, 6]]
    mimic = Chain("mimic", longer.screws, arm.home, arm.limits, arm.joint_names, coupling=coupling)
    with pytest.raises(ArrayError, match="has 7 and mimic joints"):
        prepare(mimic)
    slides = np.eye(3, 6)[[0, 1, 0, 1, 2, 0, 1]]
    sliding = Chain("sliding", slides, np.eye(4), np.tile([-1.0, 1.0], (7, 1)), arm.joint_names)
    with pytest.raises(ArrayError, match="no six joints of 'sliding' can be solved completely"):
        prepare(sliding)
    free_rail = arm_of("UR5e on a rail")
    limits = free_rail.limits.copy()
    limits[0] = [-np.inf, np.inf]
    free_rail = Chain("free rail", free_rail.screws, free_rail.home, limits, free_rail.joint_names)
    with pytest.raises(ArrayError, match="rail slides without limits, so that there is no range to sample"):
        solve_redundant(free_rail, np.eye(4))


def test_values_broadcast_with_the_poses():
    arm = chain("franka_panda")
    q = np.array([0.1, -0.5, 0.2, -2.0, 0.3, 1.6, 0.7])
    T = fk(arm, q)
    many = solve_redundant(arm, T, values=[[0.7, 0.1], [0.2, 0.7], [0.5, 0.6]])
    assert many.valid.shape[:-1] == (3,)
    for row, values in enumerate([[0.7, 0.1], [0.2, 0.7], [0.5, 0.6]]):
        np.testing.assert_array_equal(many.q[row], solve_redundant(arm, T, values=values).q)
    with pytest.raises(ArrayError, match="the leading axes of T_base_tip and values must broadcast"):
        solve_redundant(arm, np.stack([T, T]), values=[[0.7], [0.2], [0.5]])
    with pytest.raises(ArrayError, match="values must be an array of real numbers"):
        solve_redundant(arm, T, values=[0.1, [0.2, 0.3]])
