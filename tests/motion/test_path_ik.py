"""Joint paths for poses: on one branch, without a jump, and with the truth about where they end."""

from __future__ import annotations

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
from pieper.motion.path import line
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
        regular = (way.sensitivity < REGULAR)[way.given]  # where branches meet either may be taken
        np.testing.assert_allclose(way.q[way.given][regular], q[regular], rtol=0, atol=1e-4)


def cheapest_by_brute_force(chain, Ts, speeds, s) -> float:
    """Dijkstra's answer by plain loops over layers: the independent truth."""
    layers = []
    for T in Ts:
        answers = solve(chain, T)
        layers.append(answers.q[answers.within_limits])
    cost = np.zeros(len(layers[0]))
    for i in range(1, len(layers)):
        following = np.full(len(layers[i]), np.inf)
        for b, q_b in enumerate(layers[i]):
            for a, q_a in enumerate(layers[i - 1]):
                apart = np.abs((q_b - q_a + np.pi) % (2 * np.pi) - np.pi)
                if apart.max() <= jump_bound(s[i] - s[i - 1]):  # and here no two branches are that near
                    following[b] = min(following[b], cost[a] + (apart / speeds).sum())
        cost = following
    return float(cost.min())


@pytest.mark.parametrize("name", ["ur5e", "kuka_kr210_robond", "crx10ia"])
def test_the_route_is_the_shortest_of_all(name):
    chain = pieper.load(name).chain
    q = np.array([0.3, -0.6, -0.4, 0.7, -0.9, 0.3])
    T = fk(chain, q)
    path = line(T, shifted(T, 0.05, -0.1, 0.03))
    s, Ts = path.sample(count=15)
    way = follow_path(chain, Ts, max_velocity=2.0)
    assert way.complete
    speeds = np.minimum(2.0, chain.max_velocity)
    cost = (np.abs(np.diff(way.q, axis=0)) / speeds).sum()
    assert cost == pytest.approx(cheapest_by_brute_force(chain, Ts, speeds, s), rel=1e-9)


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
    with pytest.raises(ArrayError, match="precision must be above 0"):
        follow_path(chain, T[None], precision=0.0)
    with pytest.raises(ArrayError, match="poses are taken as they are"):
        follow_path(chain, T[None], count=4)
    with pytest.raises(UnknownNameError, match="no target 'point'"):
        follow_path(chain, T[None], target="point")
    with pytest.raises(ArrayError, match=r"q_start must have shape \(6,\)"):
        follow_path(chain, T[None], q_start=[HOME])
