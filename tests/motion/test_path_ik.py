"""Joint paths for poses: on one branch, without a jump, and with the truth about where they end."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pieper
from pieper.errors import ArrayError, UnknownNameError
from pieper.ik.iteration import iterate
from pieper.ik.solve import solve
from pieper.kinematics.fk import fk
from pieper.kinematics.jacobian import jacobian
from pieper.motion.path import join, line
from pieper.motion.path_ik import follow_path, jump_bound
from pieper.spatial import pose
from tests import robots

REACHED = 1e-8  # [m, -] tolerance of the solvers, and ten times that of rounding
REGULAR = 300.0  # [rad/m] a path of 2 mm steps keeps to its branch below it
HOME = [0.3, -1.2, 1.4, -1.7, -1.5, 0.3]
SIX = [robot.name for robot in robots.ROBOTS if robot.dof == 6]


def shifted(T: np.ndarray, *by: float) -> np.ndarray:
    moved = T.copy()
    moved[:3, 3] += by
    return moved


@settings(max_examples=12, deadline=None)
@given(st.sampled_from(robots.NAMES), st.integers(0, 1000))
def test_a_smooth_joint_motion_is_found_again_from_its_poses(name, seed):
    chain = robots.chain(name)
    rng = np.random.default_rng(seed)
    lower, upper = np.clip(chain.limits, -2.5, 2.5).T
    a = rng.uniform(lower + 0.1 * (upper - lower), upper - 0.1 * (upper - lower))
    b = np.clip(a + rng.uniform(-0.3, 0.3, chain.dof), lower, upper)
    q = a + np.linspace(0, 1, 60)[:, None] * (b - a)
    way = follow_path(chain, fk(chain, q), q_start=q[0])
    assert way.complete, way.broken
    T = fk(chain, way.q[way.given])
    np.testing.assert_allclose(T, fk(chain, q), rtol=0, atol=REACHED)
    assert (np.abs(np.diff(way.q, axis=0)).max(axis=1) <= jump_bound(np.diff(way.s)) + 1e-12).all()
    assert (way.q >= chain.limits[:, 0]).all()
    assert (way.q <= chain.limits[:, 1]).all()
    if chain.dof <= 6:  # no joint to spare: the motion itself, not another one
        # where branches meet either may be taken, and led on from there
        regular = np.logical_and.accumulate(way.sensitivity < REGULAR)[way.given]
        np.testing.assert_allclose(way.q[way.given][regular], q[regular], rtol=0, atol=1e-4)


def apart(q: np.ndarray) -> np.ndarray:
    """Differences of joint values by less than half a turn."""
    return np.abs(q - 2 * np.pi * np.rint(q / (2 * np.pi)))


def cheapest_by_brute_force(chain, Ts, speeds, s) -> tuple[float, int]:
    """The independent truth, by a dynamic programme over every answer with every copy by whole turns within the limits.

    The cost of the cheapest route, infinite if there is none, and the last pose that any route comes to. A step may go from an answer to
    one that is the nearest from either side, and no joint further than `jump_bound`: so no route changes its branch between two poses.
    """
    reached, last = np.zeros(0), -1
    before: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
    for i, T in enumerate(Ts):
        answers = solve(chain, T)
        listed = answers.q[answers.within_limits]
        copies, of = [], []
        for n, q in enumerate(listed):
            choices = [
                [q[j] + 2 * np.pi * k for k in range(-3, 4) if low - 1e-9 <= q[j] + 2 * np.pi * k <= high + 1e-9]
                for j, (low, high) in enumerate(chain.limits)
            ]
            more = list(itertools.product(*choices))
            copies += more
            of += [n] * len(more)
        now = np.array(copies).reshape(-1, chain.dof), np.array(of, dtype=int), listed
        if before is None:
            reached = np.zeros(len(copies))
        else:
            if not len(copies) or not len(reached):
                break
            farthest = apart(listed[None] - before[2][:, None]).max(axis=2)
            near = farthest <= np.maximum(farthest.min(axis=1, keepdims=True), farthest.min(axis=0)) + 1e-9
            step = np.abs(now[0][None] - before[0][:, None])
            allowed = (step.max(axis=2) <= jump_bound(s[i] - s[i - 1]) + 1e-9) & near[np.ix_(before[1], now[1])]
            reached = (np.where(allowed, (step / speeds).sum(axis=2), np.inf) + reached[:, None]).min(axis=0)
        if not np.isfinite(reached).any():
            break
        before, last = now, i
    return (float(reached.min()) if last == len(Ts) - 1 else np.inf), last


@pytest.mark.parametrize("name", ["ur5e", "kuka_kr210_robond", "yaskawa_mh12", "crx10ia"])
def test_the_route_is_the_shortest_of_all(name):
    """Random lines, half of them with narrow limits: as cheap as the brute-force answer, and never broken earlier."""
    whole = pieper.load(name).chain
    rng = np.random.default_rng(5)
    compared = 0
    for trial in range(12):
        chain = whole
        if trial % 2:
            half, middle = rng.uniform(1.0, 4.0, 6), rng.uniform(-1.0, 1.0, 6)
            chain = dataclasses.replace(whole, limits=np.stack([middle - half, middle + half], axis=1))
        lower, upper = np.clip(chain.limits, -6.0, 6.0).T
        q = rng.uniform(lower, upper)
        goal = np.clip(q + rng.uniform(-1.0, 1.0, 6), lower, upper)
        path = line(fk(chain, q), fk(chain, goal))
        s, Ts = path.sample(count=max(12, int(path.length / 0.03)))
        way = follow_path(chain, Ts, max_velocity=2.0)
        speeds = np.minimum(2.0, chain.max_velocity)
        cost, last = cheapest_by_brute_force(chain, Ts, speeds, s)
        if way.complete and way.given.all():
            assert (np.abs(np.diff(way.q, axis=0)) / speeds).sum() == pytest.approx(cost, rel=1e-9)
            compared += 1
        elif way.broken is not None:
            assert cost == np.inf
            assert way.broken.index >= last
    assert compared >= 2


def test_whole_turns_are_undone_up_to_the_limits():
    chain = robots.chain("ur5e")
    q = np.tile(HOME, (80, 1))
    q[:, 5] = np.linspace(-4.0, 6.0, 80)  # past pi, where an angle wraps
    way = follow_path(chain, fk(chain, q))
    np.testing.assert_allclose(way.q[:, 5] - way.q[0, 5], q[:, 5] - q[0, 5], atol=1e-9)
    assert np.abs(way.q).max() <= 2 * np.pi


def test_a_limit_breaks_the_path_at_its_place():
    chain = robots.chain("ur5e")
    q = np.tile(HOME, (100, 1))
    q[:, 5] = np.linspace(-6.0, 8.0, 100)  # more than two turns; the joint has two
    way = follow_path(chain, fk(chain, q), q_start=q[0])
    assert way.broken is not None
    assert way.broken.reason == "limit"
    assert "wrist_3_joint" in way.broken.message
    assert way.broken.index == np.searchsorted(q[:, 5], 2 * np.pi) - 1
    assert way.q[-1, 5] == pytest.approx(2 * np.pi, abs=1e-4)  # 1e-6 m of length is 1e-5 rad


def test_out_of_reach_breaks_the_path_at_its_place():
    chain = robots.chain("ur5e")
    T = fk(chain, HOME)
    goal = shifted(T, 0.9, -0.3, 0.1)
    path = line(T, goal)
    way = follow_path(chain, path)
    assert way.broken is not None
    assert way.broken.reason == "unreachable"
    low, high = 0.0, path.length  # the truth by bisection of the solver alone
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if solve(chain, path.at(middle)).reached else (low, middle)
    assert way.broken.s == pytest.approx(low, abs=2 * way.broken.precision)
    assert way.s[-1] == way.broken.s


def test_a_first_pose_out_of_reach_is_a_result():
    chain = robots.chain("ur5e")
    T = pose.from_xyz_rpy([[3.0, 0, 0], [2.9, 0, 0]], [[0, 0, 0], [0, 0, 0]])
    way = follow_path(chain, T)
    assert len(way.q) == 0
    assert way.broken is not None
    assert way.broken.index == -1
    assert "out of reach" in way.broken.message


@pytest.mark.parametrize("off", [0.0, 1e-4, 1e-2])
def test_a_straight_wrist_is_passed_without_a_jump(off):
    chain = robots.chain("kuka_kr210_robond")
    A, B = fk(chain, [0.0, 0.2, -0.3, 0.0, 0.3, 0.0]), fk(chain, [0.0, 0.3, -0.2, 0.0, -0.3, 0.0])
    B[1, 3] += off
    path = line(A, B)
    way = follow_path(chain, path, step=0.005)
    assert way.complete, way.broken
    assert np.abs(np.diff(way.q, axis=0)).max() <= 0.5
    np.testing.assert_allclose(fk(chain, way.q), path.at(way.s), rtol=0, atol=REACHED)
    if off == 1e-2:
        assert (~way.given).any()  # smaller steps near the singularity
        assert way.sensitivity.max() > 1e3


WRIST = {
    "kuka_kr210_robond": [0.2, 0.2, -0.3, 0.1, 0.4, 0.2],
    "ur5e": [0.3, -1.2, 1.4, -1.7, 0.4, 0.3],
    "yaskawa_mh12": [0.2, 0.2, -0.3, 0.1, -0.5, 0.2],
}


@pytest.mark.parametrize("off", [0.0, 1e-9, 1e-4, 1e-2])
@pytest.mark.parametrize("name", WRIST)
def test_a_line_through_the_wrist_singularity_is_driven_within_the_speed_limits(name, off):
    pytest.importorskip("ruckig")
    from pieper.motion.limits import JointLimits
    from pieper.motion.timing import time_path, usage

    chain, q = robots.chain(name), np.array(WRIST[name])
    other = q * [1, 1, 1, 1, -1, 1] + [0.1, 0.1, 0, 0, 0, 0]
    A, B = fk(chain, q), fk(chain, other)
    B[1, 3] += off
    path = line(A, B)
    way = follow_path(chain, path, q_start=q)
    assert way.complete, way.broken
    assert np.sign(way.q[0, 4]) == -np.sign(way.q[-1, 4]) or way.sensitivity.max() > 300.0  # through it, or just beside
    np.testing.assert_allclose(fk(chain, way.q), path.at(way.s), rtol=0, atol=REACHED)
    assert (np.abs(np.diff(way.q, axis=0)).max(axis=1) <= jump_bound(np.diff(way.s)) + 1e-12).all()
    stated = {"max_velocity": 0.8, "max_acceleration": 3.0, "max_jerk": 30.0}
    move = time_path(way, **stated)
    assert max(usage(move, JointLimits.of(chain, **stated))) <= 1.0 + 1e-6
    assert np.abs(move.sample(np.linspace(0.0, move.duration, 3000)).dq).max() <= 0.8 * (1.0 + 1e-6)


@pytest.mark.parametrize("name", WRIST)
def test_an_arm_that_stands_in_its_singularity_is_told_how_to_begin(name):
    chain, q = robots.chain(name), np.array(WRIST[name])
    q[4] = 0.0
    A = fk(chain, q)
    path = line(A, shifted(A, -0.1, 0.0, 0.05))
    way = follow_path(chain, path, q_start=q)
    assert way.broken is not None
    assert (way.broken.reason, way.broken.s) == ("singularity", 0.0)
    np.testing.assert_array_equal(way.q, [q])  # it stays where it is
    assert "the path goes on from the same pose with" in way.broken.message
    assert way.broken.start is not None
    np.testing.assert_allclose(fk(chain, way.broken.start), A, rtol=0, atol=REACHED)
    assert follow_path(chain, path, q_start=way.broken.start).complete
    assert follow_path(chain, path).complete  # and where it may begin is left to it


@pytest.mark.parametrize("name", WRIST)
def test_a_path_that_leaves_the_reach_for_a_part_ends_where_it_leaves(name):
    chain, q = robots.chain(name), WRIST[name]
    A = fk(chain, q)
    outward = A[:3, 3] / np.linalg.norm(A[:3, 3])
    path = join([line(A, shifted(A, *(2.5 * outward))), line(shifted(A, *(2.5 * outward)), shifted(A, 0, 0, 0.1))])
    way = follow_path(chain, path, q_start=q, step=0.02)
    assert way.broken is not None
    assert way.broken.reason == "unreachable"
    low, high = 0.0, float(path.corners[0])
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if solve(chain, path.at(middle)).reached else (low, middle)
    assert way.broken.s == pytest.approx(low, abs=2 * way.broken.precision)
    assert way.q.shape == (len(way.s), 6)


@pytest.mark.parametrize("name", WRIST)
def test_a_limit_on_every_branch_ends_the_path_as_late_as_can_be(name):
    """The tip turns on and on about its own axis: some joint of every branch comes to its limit, and the branch that lasts longest is taken."""
    chain, q = robots.chain(name), WRIST[name]
    turns = np.linspace(0.0, 30.0, 601)
    A = fk(chain, q)
    Ts = A @ pose.from_xyz_rpy(np.zeros((601, 3)), np.stack([0 * turns, 0 * turns, turns], axis=1))
    way = follow_path(chain, Ts)
    assert way.broken is not None
    assert way.broken.reason == "limit"
    joint = next(name for name in chain.joint_names if repr(name) in way.broken.message)
    j = chain.joint_index(joint)
    assert np.abs(way.q[-1, j] - chain.limits[j]).min() < 1e-4  # 1e-6 m of length is 1e-5 rad
    ends = []
    for label in {str(x) for x in solve(chain, Ts[0]).labels if x}:
        other = follow_path(chain, Ts, branch=label)
        assert other.broken is not None
        ends.append(other.broken.s)
    assert way.broken.s == pytest.approx(max(ends), abs=1e-5)


def test_repeated_poses_are_passed():
    chain = robots.chain("ur5e")
    T = fk(chain, HOME)
    Ts = np.stack([T, T, shifted(T, 0.01, 0, 0), shifted(T, 0.01, 0, 0), T])
    way = follow_path(chain, Ts, q_start=HOME)
    assert way.complete
    np.testing.assert_allclose(way.q[[0, 1, 4]], np.tile(HOME, (3, 1)), atol=1e-9)
    assert len(follow_path(chain, T[None]).q) == 1


def test_the_branch_is_the_one_asked_for():
    chain = robots.chain("ur5e")
    T = fk(chain, HOME)
    for words in ("elbow up", "elbow down, flip"):
        way = follow_path(chain, line(T, shifted(T, 0.1, 0.0, 0.0)), branch=words)
        assert set(words.split(", ")) <= set(way.branch[0].split(", "))
        assert set(way.branch) == {way.branch[0]}
    with pytest.raises(UnknownNameError, match="no label 'elbow sideways'"):
        follow_path(chain, line(T, T), branch="elbow sideways")


def test_margin_and_sensitivity_are_those_of_each_pose():
    chain = robots.chain("ur5e")
    T = fk(chain, HOME)
    way = follow_path(chain, line(T, shifted(T, 0.1, 0.0, 0.0)), count=5)
    lower, upper = chain.limits.T
    np.testing.assert_allclose(way.margin, np.minimum(way.q - lower, upper - way.q).min(axis=1))
    J = np.array([pieper.load("ur5e").jacobian(q) for q in way.q])
    J[:, 3:] *= 0.1
    np.testing.assert_allclose(way.sensitivity, np.linalg.norm(np.linalg.inv(J), 2, axis=(1, 2)), rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "target", "method"),
    [("panda", "pose", "tracked"), ("mh12-report", "position", "tracked"), ("so100", "axis", "layers")],
)
def test_five_and_seven_joints_follow_too(name, target, method):
    chain = pieper.load(name).chain
    middle = np.clip(chain.limits, -3.0, 3.0).mean(axis=1)
    q = middle + 0.15
    T = fk(chain, q)
    by = jacobian(chain, q)[:3, 1]  # in the plane that the second, third and fourth axes of five leave
    path = line(T, shifted(T, *(0.03 * by / np.linalg.norm(by))))
    way = follow_path(chain, path, q_start=q, target=target, count=40)
    assert way.method == method
    assert way.complete, way.broken
    Ts, wanted = fk(chain, way.q), path.at(way.s)
    np.testing.assert_allclose(Ts[:, :3, 3], wanted[:, :3, 3], rtol=0, atol=REACHED)
    if target != "position":
        np.testing.assert_allclose(Ts[:, :3, 2], wanted[:, :3, 2], rtol=0, atol=REACHED)


def test_a_tracked_arm_names_the_limit_that_it_ends_at():
    chain = robots.chain("franka_panda")
    q = np.clip(chain.limits, -3.0, 3.0).mean(axis=1) + 0.1
    q[6] = chain.limits[6, 1] - 0.05
    turned = fk(chain, q) @ pose.from_xyz_rpy([0, 0, 0], [0, 0, 1.5])
    way = follow_path(chain, line(fk(chain, q), turned), q_start=q)
    assert way.broken is not None
    assert way.broken.reason == "limit"
    assert "'panda_joint7' is at its limit" in way.broken.message
    assert (way.q <= chain.limits[:, 1]).all()
    assert (way.q >= chain.limits[:, 0]).all()


def test_C13_iteration_along_a_path_and_the_closed_form_make_the_same_motion():
    chain = robots.chain("ur5e")
    T = fk(chain, HOME)
    path = line(T, shifted(T, 0.1, -0.1, 0.05))
    by_layers = follow_path(chain, path, q_start=HOME, target="pose", count=30)
    from pieper.ik.numeric import solve_numeric

    q = np.array(HOME)
    for k, pose_k in enumerate(path.at(by_layers.s)):
        q = solve_numeric(chain, pose_k, seed=q).q[0]
        np.testing.assert_allclose(by_layers.q[k], q, rtol=0, atol=1e-7)


def test_E6_the_target_of_the_iteration_is_reached_on_a_straight_line():
    chain = robots.chain("ur5e")
    start = np.array([-1.28, 4.41, 1.54, -1.16, -1.56, 0.0])
    T = fk(chain, start)
    goal = T.copy()
    goal[:3, 3] = [0.50, -0.60, 0.20]
    way = follow_path(chain, line(T, goal), q_start=start)
    assert way.complete, way.broken
    np.testing.assert_allclose(fk(chain, way.q[-1]), goal, atol=REACHED)
    *_, last = iterate(
        chain, goal, start, orientation="reach", position_stop=1e-10, rotation_stop=1e-10, iterations=100
    )
    np.testing.assert_allclose(way.q[-1], last.q, atol=1e-6)


def test_malformed_questions_are_refused():
    chain = robots.chain("ur5e")
    T = fk(chain, HOME)
    for senseless in (0.0, -1e-6, np.nan, 1e-30):
        with pytest.raises(ArrayError, match=r"precision must be at least 1e-09 m, .* got"):
            follow_path(chain, T[None], precision=senseless)
    with pytest.raises(ArrayError, match="poses are taken as they are"):
        follow_path(chain, T[None], count=4)
    with pytest.raises(UnknownNameError, match="no target 'point'"):
        follow_path(chain, T[None], target="point")
    with pytest.raises(ArrayError, match=r"q_start must have shape \(6,\)"):
        follow_path(chain, T[None], q_start=[HOME])
