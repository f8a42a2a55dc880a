"""Rounded corners: never slower, never beyond a limit, never nearer to anything than was promised, and straight where they were."""

from __future__ import annotations

import itertools
from importlib.util import find_spec

import numpy as np
import pytest

import pieper
from pieper.errors import ArrayError, MissingExtraError, MotionError
from pieper.motion.limits import JointLimits
from pieper.motion.world import World
from tests.motion.worlds import at, post, states
from tests.robots import NAMES, chain

pytest.importorskip("coal")
pytest.importorskip("ruckig")

from pieper.motion.blending import time_blended
from pieper.motion.collision import CollisionModel
from pieper.motion.edges import EdgeCheck
from pieper.motion.planning import plan
from pieper.motion.timing import TcpLimits, time_waypoints, usage

needs_ompl = pytest.mark.skipif(find_spec("ompl") is None, reason="ompl is not installed")

HELD = 1e-6  # of a limit, over every sample: what the issue of motions asks for
ON_THE_LINE = 1e-9  # [rad] rounding of polynomials in time

UR5E = pieper.load("ur5e")
START = np.array([1.2, -1.2, 1.2, -1.6, -1.6, 0.0])
GOAL = np.array([-1.2, -1.2, 1.2, -1.6, -1.6, 0.0])
OVER = np.array([0.0, -2.0, 1.2, -1.0, -1.6, 0.3])  # above the post


def free_edges(model: CollisionModel) -> EdgeCheck:
    return EdgeCheck(model)


def sampled(trajectory, step: float = 0.002):
    return trajectory.sample(np.append(np.arange(0.0, trajectory.duration, step), trajectory.duration))


@pytest.mark.parametrize("name", NAMES)
def test_every_arm_holds_its_limits_and_is_never_slower(name):
    arm = chain(name)
    model = CollisionModel(arm, margin=0.0)
    q = states(arm, 40, seed=3)
    q = q[model.is_free(q)][:4]
    if len(q) < 3:
        pytest.skip("hardly a state is free")
    q = q[0] + 0.2 * (q - q[0])
    found = time_blended(free_edges(model), q)
    resting = time_waypoints(arm, q)
    assert found.at_rest == pytest.approx(resting.duration)
    assert found.trajectory.duration <= resting.duration * (1.0 + 1e-12)
    limits = JointLimits.of(arm)
    assert max(usage(found.trajectory, limits)) <= 1.0 + HELD
    limits.check_trajectory(found.trajectory)
    s = sampled(found.trajectory)
    assert (np.abs(s.dq) <= limits.velocity * (1.0 + HELD)).all()
    assert (np.abs(s.ddq) <= limits.acceleration * (1.0 + HELD)).all()
    np.testing.assert_array_equal(found.trajectory.q[[0, -1]], q[[0, -1]])
    assert not np.any([found.trajectory.dq[[0, -1]], found.trajectory.ddq[[0, -1]]])


def apart_from_edges(q: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distance of each state from the nearest edge [rad]."""
    found = []
    for a, b in itertools.pairwise(points):
        u = np.clip((q - a) @ (b - a) / float((b - a) @ (b - a)), 0.0, 1.0)
        found.append(np.linalg.norm(q - a - u[:, None] * (b - a), axis=1))
    return np.min(found, axis=0)


def test_a_corner_is_rounded_and_the_rest_stays_on_its_edges():
    points = np.stack([START, OVER, GOAL])
    found = time_blended(free_edges(CollisionModel(UR5E, post())), points)
    assert found.rounded[1] > 0.0
    assert found.trajectory.duration < 0.95 * found.at_rest
    q = sampled(found.trajectory).q
    apart = apart_from_edges(q, points)
    assert apart.max() > 1e-3  # it does cut the corner
    velocity = JointLimits.of(UR5E.chain).velocity
    from_corner = np.linalg.norm((q - OVER) / velocity, axis=1)
    assert apart[from_corner > found.rounded[1] + 1e-9].max() < ON_THE_LINE
    speed = np.linalg.norm(sampled(found.trajectory).dq, axis=1)
    assert speed[len(speed) // 4 : -len(speed) // 4].min() > 0.2  # no stop between


@needs_ompl
def test_what_is_rounded_keeps_its_distance():
    """Coal on every sample, against what the path kept less what the chords leave out."""
    model = CollisionModel(UR5E, post(), margin=0.01)
    for seed in range(3):
        path = plan(model, START, GOAL, timeout=30.0, seed=seed)
        edges = free_edges(model)
        found = time_blended(edges, path.q)
        assert found.off <= 1.01e-4
        q = sampled(found.trajectory, 0.01).q
        assert model.bounds(q, 0.1).min() >= path.kept - found.off - 2e-5


@needs_ompl
def test_what_is_rounded_touches_nothing_as_mujoco_sees_it():
    pytest.importorskip("mujoco")
    from benchmarks.shelves import Judge

    model = CollisionModel(UR5E, post())
    path = plan(model, START, GOAL, timeout=30.0)
    judge = Judge(model)
    for q in sampled(path.trajectory(model), 0.01).q:
        assert not judge.touches(q)


@needs_ompl
def test_a_corner_that_hugs_an_obstacle_is_not_cut():
    """Around the edge of a plate the way turns within millimetres: inside the corner is the plate."""
    model = CollisionModel(UR5E, post(), margin=0.01)
    edges = free_edges(model)
    free = time_blended(EdgeCheck(CollisionModel(UR5E, World(), margin=0.01)), plan(model, START, GOAL, timeout=30.0).q)
    path = plan(model, START, GOAL, timeout=30.0)
    near = time_blended(edges, path.q)
    assert (near.rounded <= free.rounded + 1e-12).all()
    assert near.trajectory.duration >= free.trajectory.duration * (1.0 - 1e-9)


def test_rests_where_it_is_told_to():
    points = np.stack([START, OVER, GOAL])
    edges = free_edges(CollisionModel(UR5E, post()))
    found = time_blended(edges, points, rest_at=[1])
    assert not found.rounded.any()
    assert found.trajectory.duration == found.at_rest
    with pytest.raises(ArrayError, match="rest_at must be way points from 0 to 2, got 5"):
        time_blended(edges, points, rest_at=[5])


def test_an_approach_is_not_cut():
    T = at(0.4, -0.35, 0.3, (np.pi, 0.0, 0.0))
    model = CollisionModel(UR5E, post())
    path = plan(model, START, T, timeout=30.0, approach=[0.0, 0.0, -0.1])
    assert path.rests_at == (len(path.q) - 2,)
    move = path.trajectory(model)
    slowest = np.abs(sampled(move, 1e-4).q - path.q[-2]).max(axis=1).argmin()
    assert np.abs(sampled(move, 1e-4).dq[slowest]).max() < 0.02


def test_the_way_back_along_an_edge_rests():
    points = np.stack([START, OVER, START + 0.001])
    found = time_blended(free_edges(CollisionModel(UR5E, post())), points)
    assert found.rounded[1] == 0.0


@needs_ompl
def test_a_motion_that_is_stopped_at_any_moment_leaves_the_arm_at_rest_within_its_limits():
    from pieper.sim.kinematic import KinematicSimulator

    model = CollisionModel(UR5E, post())
    move = plan(model, START, GOAL, timeout=30.0).trajectory(model)
    lower, upper = UR5E.chain.limits.T
    for share in np.random.default_rng(2).uniform(0.0, 1.0, 20):
        robot = KinematicSimulator(UR5E.chain, q=START)
        robot.follow(move)
        robot.step(float(share) * move.duration)
        robot.stop()
        state = robot.read()
        assert not state.dq.any()
        assert ((lower <= state.q) & (state.q <= upper)).all()
        assert model.with_margin(0.0).is_free(state.q)
        np.testing.assert_array_equal(robot.step(1.0).q, state.q)


@needs_ompl
def test_what_is_planned_until_it_is_cancelled_can_be_driven():
    model = CollisionModel(UR5E, post())
    asked = itertools.count()
    path = plan(model, START, GOAL, timeout=30.0, cancelled=lambda: next(asked) > 12)
    assert path.status == "cancelled"
    move = path.trajectory(model)
    np.testing.assert_array_equal(move.q[[0, -1]], path.q[[0, -1]])
    assert model.bounds(sampled(move, 0.01).q, 0.1).min() > 0.0


def test_limits_of_the_tip():
    tcp = TcpLimits(velocity=0.3, acceleration=1.0, jerk=10.0)
    found = time_blended(free_edges(CollisionModel(UR5E, post())), np.stack([START, OVER, GOAL]), tcp=tcp)
    assert max(usage(found.trajectory, JointLimits.of(UR5E.chain), tcp)) <= 1.0 + HELD
    assert found.trajectory.duration < found.at_rest


def test_limits_that_are_given_are_held():
    given = {"max_velocity": [1, 2, 1, 2, 1, 2], "max_acceleration": 4.0, "max_jerk": 15.0}
    model = CollisionModel(UR5E, post())
    found = time_blended(free_edges(model), np.stack([START, OVER, GOAL]), **given)
    assert max(usage(found.trajectory, JointLimits.of(UR5E.chain, **given))) <= 1.0 + HELD


def test_points_that_repeat_and_ways_of_no_length():
    edges = free_edges(CollisionModel(UR5E, post()))
    once = time_blended(edges, np.stack([START, OVER, GOAL]))
    again = time_blended(edges, np.stack([START, START, OVER, OVER, GOAL, GOAL]))
    assert again.trajectory.duration == pytest.approx(once.trajectory.duration, rel=1e-9)
    assert (again.rounded > 0).sum() == 1
    for points in (START[None], np.stack([START, START])):
        still = time_blended(edges, points).trajectory
        assert (still.duration, len(still.t)) == (0.0, 1)
    assert time_blended(edges, np.stack([START, OVER])).trajectory.duration > 0.0


@pytest.mark.parametrize(
    ("points", "given", "complaint"),
    [
        (np.stack([START, np.full(6, np.nan)]), {}, "waypoints must be finite"),
        (START, {}, "waypoints must have shape"),
        (np.zeros((0, 6)), {}, "waypoints must have shape"),
        (np.stack([START, START + 9.0]), {}, "is outside its limits"),
        (np.stack([START, OVER]), {"max_velocity": 0.0}, "max_velocity must be above 0"),
        (np.stack([START, OVER]), {"max_jerk": np.inf}, "max_jerk must be finite"),
        (np.stack([START, OVER]), {"max_acceleration": np.nan}, "max_acceleration must be finite"),
        (np.stack([START, OVER]), {"max_velocity": [1.0, 2.0]}, "max_velocity must be one number"),
    ],
)
def test_malformed_ways(points, given, complaint):
    with pytest.raises((ArrayError, MotionError), match=complaint):
        time_blended(free_edges(CollisionModel(UR5E, post())), points, **given)


def test_without_ruckig_the_message_says_what_to_install(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "ruckig", None)
    with pytest.raises(MissingExtraError, match=r"ruckig is not installed.*pip install 'pieper\[plan\]'"):
        time_blended(free_edges(CollisionModel(UR5E, post())), np.stack([START, OVER]))
