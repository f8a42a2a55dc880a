"""The controller over the simulated arm: what it takes, what it refuses, and what it tells."""

from __future__ import annotations

import itertools
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pieper
from pieper.motion.joint_move import joint_move
from pieper.ros.actions import ActionClient, GoalStatus
from pieper.ros.fake import FakeNetwork
from pieper.ros.nodes.controller import Controller
from pieper.sim.kinematic import KinematicSimulator

JOINT_STATE = "sensor_msgs/msg/JointState"
JOINT_TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
FOLLOW = "control_msgs/action/FollowJointTrajectory"
TRIGGER = "std_srvs/srv/Trigger"

SECOND = 10**9
PERIOD = 0.01  # [s] between two joint states
ROUNDING = 1e-12  # [rad] interpolation, and sums of steps of time


class Cell:
    """A controller, and a user who hears what it says."""

    def __init__(self, arm="mh12", *parameters, robot=None, q=None):
        self.arm = pieper.load(arm)
        self.network = FakeNetwork()
        arguments = ["--ros-args", *(word for p in parameters for word in ("-p", p))] if parameters else []
        self.bus, self.user = self.network.bus("controller", arguments), self.network.bus("user")
        self.robot = robot or KinematicSimulator(self.arm.chain, q=q)
        self.node = Controller(self.bus, self.robot)
        self.heard = []
        self.user.subscribe("joint_states", JOINT_STATE, self.heard.append)
        self._set = self.user.publisher("set_joint_states", JOINT_STATE)
        self._trajectory = self.user.publisher("joint_trajectory", JOINT_TRAJECTORY)
        self.action = ActionClient(self.user, "follow_joint_trajectory", FOLLOW)

    @property
    def q(self):
        return self.robot.read().q

    def set(self, seconds=0.0, **fields):
        self._set.send(**fields)
        self.pass_time(seconds)

    def trajectory(self, message, seconds=0.0):
        self._trajectory.send(message)
        self.pass_time(seconds)

    def goal(self, trajectory, seconds=0.0, on_feedback=None, **fields):
        sent = self.action.send({"trajectory": trajectory, **fields}, on_feedback=on_feedback)
        self.pass_time(seconds)
        return sent

    def call(self, service):
        answers = []
        self.user.client(service, TRIGGER).send(answers.append)
        self.pass_time()
        return answers[0]

    def pass_time(self, seconds=0.0):
        self.network.settle()
        if seconds:
            self.network.advance(seconds, step=0.005)
        assert not self.bus.errors

    def refused(self, reason):
        return any("refused" in line and reason in line for line in self.bus.lines)


@pytest.fixture
def cell():
    return Cell()


def duration(seconds):
    whole, rest = divmod(round(seconds * 1e9), SECOND)
    return {"sec": whole, "nanosec": rest}


def point(t, positions, velocities=(), accelerations=()):
    return {
        "time_from_start": duration(t),
        "positions": positions,
        "velocities": velocities,
        "accelerations": accelerations,
    }


def moves(names, *points, stamp=0):
    return {"header": {"stamp": duration(stamp * 1e-9)}, "joint_names": list(names), "points": list(points)}


MH12 = ("joint_1_s", "joint_2_l", "joint_3_u", "joint_4_r", "joint_5_b", "joint_6_t")
GOAL = np.array([0.4, -0.3, 0.2, 0.1, -0.2, 0.3])


# Joint states


def test_joint_states_come_at_the_rate_with_names_positions_velocities_and_stamps(cell):
    cell.set(1.0, name=["joint_1_s"], position=[2.0])
    assert len(cell.heard) == 100
    stamps = np.array([m.header.stamp.sec * SECOND + m.header.stamp.nanosec for m in cell.heard])
    np.testing.assert_array_equal(np.diff(stamps), round(PERIOD * SECOND))
    assert all(tuple(m.name) == MH12 for m in cell.heard)
    q = np.array([m.position for m in cell.heard])
    dq = np.array([m.velocity for m in cell.heard])
    moving = dq[:, 0] > 0.0
    assert 10 < moving.sum() < 90
    np.testing.assert_allclose(np.diff(q[:, 0])[moving[1:]], PERIOD * dq[1:, 0][moving[1:]], atol=PERIOD * 4.0)
    np.testing.assert_allclose(dq[:40, 0], 3.84, atol=0.01)
    np.testing.assert_array_equal(q[-1], [2.0, 0, 0, 0, 0, 0])


def test_stamps_are_of_when_the_arm_was_there():
    """Also when something took its time before the message went out, as the check of a long trajectory does."""
    arm = pieper.load("mh12")

    class Slow(KinematicSimulator):
        delays: ClassVar = itertools.cycle([0, 3_000_000, 1_000_000])

        def read(self):
            state = super().read()
            cell.network.time += next(self.delays)
            return state

    robot = KinematicSimulator(arm.chain)
    cell = Cell(robot=robot)
    robot.__class__ = Slow
    cell.set(0.5, name=["joint_1_s"], position=[2.0])
    stamps = np.array([m.header.stamp.sec * SECOND + m.header.stamp.nanosec for m in cell.heard])
    q = np.array([m.position[0] for m in cell.heard])
    moving = (q[:-1] > 0.0) & (q[1:] < 2.0)
    assert moving.sum() > 10
    speed = np.diff(q)[moving] / (np.diff(stamps)[moving] / SECOND)
    np.testing.assert_allclose(speed, arm.chain.max_velocity[0], rtol=1e-9)


def test_the_rate_is_a_parameter():
    cell = Cell("mh12", "rate:=20.0")
    cell.pass_time(1.0)
    assert len(cell.heard) == 20


def test_B12_what_the_inverse_node_publishes_is_followed_by_name(cell):
    """[t1, t2, t3, 0.0, -t4, t5] of the report's example target (0.3, 0.3, 0.3)."""
    t = [0.785398, 0.215964, -1.418371, 0.141938, -6.2e-5]
    names = ["joint_1_s", "joint_2_l", "joint_3_u", "joint_4_r", "joint_5_b", "joint_6_t"]
    cell.set(2.0, header={"stamp": {"sec": 1}}, name=names, position=[t[0], t[1], t[2], 0.0, -t[3], t[4]])
    heard = cell.heard[-1]
    np.testing.assert_array_equal(heard.position, [0.785398, 0.215964, -1.418371, 0.0, -0.141938, -6.2e-5])
    assert heard.position.dtype == np.float64
    assert heard.header.stamp.sec == cell.network.time // SECOND


def test_E3_the_controller_of_the_ur_report():
    """It copies the names that it hears on joint_states and publishes set_joint_states."""
    cell = Cell("ur5e")
    cell.pass_time(0.1)
    wanted = [-1.28, 4.41, 1.54, -1.16, -1.56, 0.0]
    cell.set(3.0, name=list(cell.heard[-1].name), position=wanted)
    np.testing.assert_array_equal(cell.heard[-1].position, wanted)
    T = cell.arm.fk(cell.heard[-1].position)
    np.testing.assert_allclose(T[:3, 3], [0.224996413, -0.283120100, 0.589463254], atol=1e-9)  # nine printed digits


def test_some_joints_by_name_and_the_others_stay(cell):
    cell.set(2.0, name=list(MH12), position=GOAL)
    cell.set(2.0, name=["joint_6_t", "joint_2_l"], position=[-1.0, 0.5])
    np.testing.assert_allclose(cell.q, [0.4, 0.5, 0.2, 0.1, -0.2, -1.0], atol=ROUNDING)


NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        (
            {"name": ["joint_1_s"], "position": [3.2]},
            "joint 'joint_1_s' at 3.2 rad is outside its limits [-2.967, 2.967] rad",
        ),
        ({"name": ["elbow"], "position": [0.1]}, "no joint 'elbow'; joints are: joint_1_s, joint_2_l, "),
        ({"name": ["joint_1_s"] * 2, "position": [0.1, 0.2]}, "joint 'joint_1_s' is named 2 times"),
        ({"name": ["joint_1_s"], "position": [NAN]}, "must be finite, got nan"),
        ({"name": ["joint_1_s"], "position": [INF]}, "must be finite, got inf"),
        ({"name": ["joint_1_s"], "position": [0.1, 0.2]}, "1 joints are named, and there are 2 values of position"),
        (
            {"name": ["joint_1_s", "joint_2_l"], "position": [0.1]},
            "2 joints are named, and there are 1 values of position",
        ),
        ({"name": ["joint_1_s"]}, "there are 0 values of position"),
        ({"name": ["joint_1_s"], "position": [0.1], "velocity": [0.0, 0.0]}, "there are 2 values of velocity"),
        ({"name": ["joint_1_s"], "position": [0.1], "effort": [0.0, 0.0]}, "there are 2 values of effort"),
        ({"position": GOAL}, "no joint is named; values are taken by name, never by place"),
        ({}, "no joint is named"),
        ({"name": [*MH12, "finger"], "position": [0.1] * 7}, "no joint 'finger'"),
        ({"name": ["x" * 100_000], "position": [0.1]}, "no joint 'xxx"),
    ],
)
def test_commands_that_are_refused_change_nothing(cell, fields, reason):
    cell.set(0.05, name=list(MH12), position=GOAL)  # under way
    rosout = []
    cell.user.subscribe("/rosout", "rcl_interfaces/msg/Log", rosout.append)
    cell.set(3.0, **fields)
    assert cell.refused(reason)
    assert any(reason in line.msg and line.level == 30 and line.name == "controller" for line in rosout)
    assert all(len(line.msg) < 2000 for line in rosout)
    np.testing.assert_allclose(cell.q, GOAL, atol=ROUNDING)  # it goes on as it was


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.sampled_from([*MH12, "finger", ""]), max_size=8),
    st.lists(st.floats(width=64), max_size=8),
    st.lists(st.floats(width=64), max_size=2),
)
def test_whatever_comes_the_arm_stays_within_its_limits(names, positions, velocities):
    cell = Cell()
    cell.set(0.3, name=names, position=positions, velocity=velocities)
    lower, upper = cell.arm.limits.T
    q = np.array([m.position for m in cell.heard])
    assert ((lower <= q) & (q <= upper)).all()
    steps = np.abs(np.diff(q, axis=0, prepend=q[:1])) / PERIOD
    assert (steps <= cell.robot.limits.velocity * (1 + 1e-9)).all()


def test_a_flood_of_nonsense_is_a_line_a_second(cell):
    for _ in range(300):
        cell.set(0.01, name=["elbow"], position=[1.0])
    lines = [line for line in cell.bus.lines if "refused" in line]
    assert len(lines) == 3
    assert lines[1].endswith("(and 99 more like it)")


def test_a_flood_of_goals_that_are_refused_is_a_line_a_second(cell):
    for _ in range(300):
        cell.goal(moves(MH12), 0.01)
    assert sum("goal rejected" in line for line in cell.bus.lines) == 3


def test_commands_faster_than_the_limit():
    cell = Cell("mh12", "max_commands_per_second:=10.0")
    taken = []
    command = cell.robot.command
    cell.robot.command = lambda q: (taken.append(q["joint_1_s"]), command(q))
    for i in range(100):
        cell.set(0.01, name=["joint_1_s"], position=[0.001 * i])
    cell.pass_time(1.0)
    assert 10 <= len(taken) <= 12
    assert taken[-1] == 0.099  # the newest of all
    assert sum("commands come faster than max_commands_per_second = 10" in line for line in cell.bus.lines) == 1


def test_queues_are_bounded(cell):
    """A thousand commands while the node is busy: ten are kept, and one of them is carried out."""
    for i in range(1000):
        cell._set.send(name=["joint_1_s"], position=[0.001 * i])
    cell.pass_time(1.0)
    np.testing.assert_allclose(cell.q[0], 0.999, atol=ROUNDING)


# Trajectories on the topic


def test_a_trajectory_with_its_joints_in_any_order(cell):
    order = [3, 1, 5, 0, 2, 4]
    names = [MH12[i] for i in order]
    cell.trajectory(moves(names, point(1.0, GOAL[order]), point(2.0, 2 * GOAL[order])), 1.0)
    np.testing.assert_allclose(cell.q, GOAL, atol=1e-2)
    cell.pass_time(1.5)
    np.testing.assert_allclose(cell.q, 2 * GOAL, atol=ROUNDING)
    assert not cell.robot.is_moving


def test_velocities_and_accelerations_are_used(cell):
    """A minimum-jerk move is a quintic: positions, velocities and accelerations at both ends are the whole of it."""
    move = joint_move(cell.arm.chain, np.zeros(6), GOAL, max_velocity=0.5)
    end = point(move.duration, move.q[-1], move.dq[-1], move.ddq[-1])
    cell.trajectory(moves(MH12, point(0.0, move.q[0], move.dq[0], move.ddq[0]), end))
    began = cell.network.time
    cell.pass_time(move.duration + 0.1)
    t = np.array([m.header.stamp.sec * SECOND + m.header.stamp.nanosec - began for m in cell.heard]) * 1e-9
    now = move.sample(t)
    np.testing.assert_allclose([m.position for m in cell.heard], now.q, atol=1e-9)  # times are whole nanoseconds
    np.testing.assert_allclose([m.velocity for m in cell.heard], now.dq, atol=1e-8)


def test_a_later_start_and_a_new_trajectory_that_replaces_the_one_that_runs(cell):
    in_one_second = cell.network.time + SECOND
    cell.trajectory(moves(MH12, point(0.0, 0 * GOAL), point(1.0, GOAL), stamp=in_one_second), 1.0)
    np.testing.assert_allclose(cell.q, 0.0, atol=ROUNDING)
    cell.pass_time(0.5)
    np.testing.assert_allclose(cell.q, GOAL / 2, atol=1e-2)
    cell.trajectory(moves(MH12, point(1.0, -GOAL)), 1.5)
    np.testing.assert_allclose(cell.q, -GOAL, atol=ROUNDING)


def test_points_that_have_passed_are_left_out(cell):
    half_a_second_ago = cell.network.time - SECOND // 2
    cell.trajectory(moves(MH12, point(0.1, -GOAL), point(1.0, GOAL), stamp=half_a_second_ago), 0.25)
    np.testing.assert_allclose(cell.q, GOAL / 2, atol=1e-2)
    cell.pass_time(0.5)
    np.testing.assert_allclose(cell.q, GOAL, atol=ROUNDING)


def test_an_empty_trajectory_stops_the_arm(cell):
    cell.trajectory(moves(MH12, point(2.0, GOAL)), 1.0)
    cell.trajectory({}, 0.005)
    here = cell.q
    assert 0.4 < np.linalg.norm(here) / np.linalg.norm(GOAL) < 0.6
    cell.pass_time(2.0)
    np.testing.assert_array_equal(cell.q, here)


def test_some_joints_where_the_parameter_allows_it():
    cell = Cell("mh12", "allow_partial_joints_goal:=true")
    cell.set(2.0, name=list(MH12), position=GOAL)
    cell.trajectory(moves(["joint_3_u", "joint_1_s"], point(1.0, [-0.5, 0.0], [0.0, 0.0])), 1.5)
    np.testing.assert_allclose(cell.q, [0.0, -0.3, -0.5, 0.1, -0.2, 0.3], atol=ROUNDING)


BAD_TRAJECTORIES = [
    (moves(MH12[:5], point(1.0, GOAL[:5])), -2, "all joints of the arm have to be given, and it lacks joint_6_t"),
    (moves([*MH12[:5], "joint_1_s"], point(1.0, GOAL)), -2, "joint 'joint_1_s' is named 2 times"),
    (moves([*MH12[:5], "finger"], point(1.0, GOAL)), -2, "no joint 'finger'"),
    (moves([], point(1.0, GOAL)), -2, "no joint is named"),
    (
        moves(MH12, point(1.0, GOAL), point(1.0, GOAL)),
        -1,
        "has to increase, and is 1.0 s at point 0 and 1.0 s at point 1",
    ),
    (
        moves(MH12, point(2.0, GOAL), point(1.0, GOAL)),
        -1,
        "has to increase, and is 2.0 s at point 0 and 1.0 s at point 1",
    ),
    (moves(MH12, point(-1.0, GOAL), point(1.0, GOAL)), -1, "is -1.0 s, before its start"),
    (
        moves(MH12, point(1.0, GOAL[:5])),
        -1,
        "each point has to give positions for its 6 joints, or no point any; point 0",
    ),
    (moves(MH12, point(1.0, GOAL), point(2.0, [*GOAL, 0.0])), -1, "point 1 gives 7"),
    (moves(MH12, point(1.0, GOAL), point(2.0, [])), -1, "point 1 gives 0"),
    (moves(MH12, point(1.0, [])), -1, "its points have no positions; give them, velocities alone are not followed"),
    (
        moves(MH12, point(1.0, GOAL, GOAL * 0), point(2.0, GOAL)),
        -1,
        "give velocities for its 6 joints, or no point any",
    ),
    (moves(MH12, point(1.0, GOAL, [], GOAL * 0)), -1, "ddq needs dq"),
    (
        moves(MH12, point(1.0, [*GOAL[:5], NAN])),
        -1,
        "positions of joint 'joint_6_t' at point 0 must be finite, got nan",
    ),
    (moves(MH12, point(1.0, GOAL, [*GOAL[:5], INF])), -1, "velocities of joint 'joint_6_t' at point 0 must be finite"),
    (moves(MH12, point(1.0, GOAL, GOAL)), -1, "the velocities of its last point are not 0"),
    (moves(MH12, point(1.0, [3.2, *GOAL[1:]])), -1, "joint 'joint_1_s' at 3.2 rad is outside its limits"),
    (moves(MH12, point(0.01, GOAL)), -1, "is faster than its limit"),
    (moves(MH12, point(0.0, GOAL), point(1.0, GOAL)), -1, "the trajectory must begin where the arm is, within 0.01"),
    (moves(MH12, point(1.0, GOAL), stamp=5 * SECOND), -3, "it ended 9999"),
    (moves(MH12, point(1.0, GOAL), stamp=1_000_010_000 * SECOND), -1, "header.stamp is 10000 s ahead"),
    (moves(MH12, *[point(1e-3 * (i + 1), GOAL) for i in range(31)]), -1, "31 points, and at most 30 are taken"),
]


@pytest.mark.parametrize(("message", "code", "reason"), BAD_TRAJECTORIES)
def test_trajectories_that_are_refused_change_nothing(message, code, reason):
    cell = Cell("mh12", "max_points:=30")
    cell.trajectory(moves(MH12, point(0.5, -GOAL)), 0.1)
    cell.trajectory(message, 1.0)
    assert cell.refused(reason)
    np.testing.assert_allclose(cell.q, -GOAL, atol=ROUNDING)


# The action


def test_a_goal_is_followed_with_feedback(cell):
    heard = []
    goal = cell.goal(moves(MH12, point(1.0, GOAL)), 0.5, on_feedback=heard.append)
    assert (goal.accepted, goal.status) == (True, GoalStatus.executing)
    assert 8 <= len(heard) <= 11  # 20 in a second
    for feedback in heard:
        assert tuple(feedback.joint_names) == MH12
        t = feedback.desired.time_from_start.sec + feedback.desired.time_from_start.nanosec * 1e-9
        np.testing.assert_allclose(feedback.actual.positions, GOAL * t, atol=1e-9)
        np.testing.assert_allclose(feedback.desired.positions, feedback.actual.positions, atol=ROUNDING)
        np.testing.assert_allclose(feedback.error.positions, 0.0, atol=ROUNDING)
    cell.pass_time(0.6)
    assert (goal.status, goal.result.error_code) == (GoalStatus.succeeded, 0)
    np.testing.assert_allclose(cell.q, GOAL, atol=ROUNDING)


@pytest.mark.parametrize(
    ("message", "code", "reason"), [*BAD_TRAJECTORIES, (moves(MH12), -1, "it has no points; give one at least")]
)
@pytest.mark.parametrize("explain", [False, True])
def test_goals_that_are_refused_change_nothing(message, code, reason, explain):
    cell = Cell("mh12", "max_points:=30", f"explain_rejections:={explain}".lower())
    running = cell.goal(moves(MH12, point(0.5, -GOAL)), 0.1)
    goal = cell.goal(message, 0.1)
    names = {-1: "INVALID_GOAL", -2: "INVALID_JOINTS", -3: "OLD_HEADER_TIMESTAMP"}
    assert goal.done
    assert goal.accepted == explain
    if explain:
        assert (goal.status, goal.result.error_code) == (GoalStatus.aborted, code)
        assert reason in goal.result.error_string
    assert any(f"{names[code]}: " in line and reason in line for line in cell.bus.lines)
    cell.pass_time(1.0)
    assert running.status is GoalStatus.succeeded
    np.testing.assert_allclose(cell.q, -GOAL, atol=ROUNDING)


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"multi_dof_trajectory": {"joint_names": ["base"]}}, "multi_dof_trajectory is not supported"),
        ({"component_path_tolerance": [{}]}, "component tolerances are for several degrees of freedom"),
        ({"path_tolerance": [{"name": "finger"}]}, "INVALID_JOINTS: tolerance: no joint 'finger'"),
        (
            {"goal_tolerance": [{"name": "joint_1_s", "position": NAN}]},
            "a tolerance of joint 'joint_1_s' is not a number",
        ),
        ({"goal_tolerance": [{"name": "joint_1_s"}] * 7}, "7 tolerances for 6 joints"),
    ],
)
def test_what_else_of_a_goal_is_refused(cell, fields, reason):
    goal = cell.goal(moves(MH12, point(1.0, GOAL)), 0.5, **fields)
    assert goal.accepted is False
    assert reason in cell.bus.lines[-1]
    np.testing.assert_array_equal(cell.q, 0.0)


def test_a_goal_is_cancelled_and_the_arm_rests(cell):
    goal = cell.goal(moves(MH12, point(1.0, GOAL)), 0.5)
    goal.cancel()
    cell.pass_time(0.005)
    assert goal.status is GoalStatus.canceled
    here = cell.q
    np.testing.assert_allclose(here, GOAL / 2, atol=1e-2)
    cell.pass_time(1.0)
    np.testing.assert_array_equal(cell.q, here)


def replacements():
    yield "goal", lambda cell: cell.goal(moves(MH12, point(1.0, -GOAL))), "a new goal took its place", -GOAL
    yield (
        "trajectory",
        lambda cell: cell.trajectory(moves(MH12, point(1.0, -GOAL))),
        "a trajectory on joint_trajectory took its place",
        -GOAL,
    )
    yield (
        "command",
        lambda cell: cell.set(name=list(MH12), position=-GOAL),
        "a command on set_joint_states took its place",
        -GOAL,
    )
    yield "stop", lambda cell: cell.call("stop"), "the service stop was called", GOAL / 2
    yield "empty trajectory", lambda cell: cell.trajectory({}), "an empty trajectory stopped the arm", GOAL / 2
    yield "home", lambda cell: cell.call("home"), "the service home was called", 0 * GOAL


@pytest.mark.parametrize(
    ("replace", "reason", "end"), [r[1:] for r in replacements()], ids=[r[0] for r in replacements()]
)
def test_a_goal_is_replaced(cell, replace, reason, end):
    goal = cell.goal(moves(MH12, point(1.0, GOAL)), 0.5)
    replace(cell)
    cell.pass_time(1.2)
    assert (goal.status, goal.result.error_code, goal.result.error_string) == (GoalStatus.aborted, -1, reason)
    np.testing.assert_allclose(cell.q, end, atol=1e-2)


def test_goals_faster_than_the_limit_are_rejected():
    cell = Cell("mh12", "max_commands_per_second:=1.0")
    first, second = cell.goal(moves(MH12, point(1.0, GOAL)), 0.1), cell.goal(moves(MH12, point(1.0, -GOAL)), 1.5)
    assert (first.status, second.accepted) == (GoalStatus.succeeded, False)
    assert any("goals come faster than max_commands_per_second = 1" in line for line in cell.bus.lines)


class Lame(KinematicSimulator):
    """An arm whose first joint stays behind what it is told."""

    behind = 0.0

    def read(self):
        state = super().read()
        q = state.q.copy()
        q[0] -= self.behind
        return type(state)(state.time, q, state.dq)

    def step(self, dt):
        super().step(dt)
        return self.read()


def lame(*parameters):
    arm = pieper.load("mh12")
    return Cell("mh12", *parameters, robot=Lame(arm.chain))


def test_a_path_tolerance_is_watched():
    cell = lame()
    goal = cell.goal(moves(MH12, point(1.0, GOAL)), 0.5, path_tolerance=[{"name": "joint_1_s", "position": 0.02}])
    cell.robot.behind = 0.03
    cell.pass_time(0.1)
    assert (goal.status, goal.result.error_code) == (GoalStatus.aborted, -4)
    assert goal.result.error_string == "on the way the position of joint 'joint_1_s' is off by 0.03, more than 0.02"
    here = cell.q
    cell.pass_time(1.0)
    np.testing.assert_array_equal(cell.q, here)  # the arm is stopped


@pytest.mark.parametrize("parameter", ["path_tolerance:=0.02", "path_tolerance:=0.0"])
def test_tolerances_by_parameter_and_none(parameter):
    cell = lame(parameter, "goal_tolerance:=0.0")
    cell.robot.behind = 0.03
    goal = cell.goal(moves(MH12, point(1.0, GOAL)), 1.5)
    assert (goal.status is GoalStatus.succeeded) == (parameter == "path_tolerance:=0.0")


def test_a_negative_tolerance_is_none():
    cell = lame("path_tolerance:=0.02")
    cell.robot.behind = 0.03
    tolerances = {kind: [{"name": "joint_1_s", "position": -1.0}] for kind in ("path_tolerance", "goal_tolerance")}
    assert cell.goal(moves(MH12, point(1.0, GOAL)), 1.5, **tolerances).status is GoalStatus.succeeded


def test_the_end_is_waited_for_and_then_given_up():
    cell = lame("goal_time:=0.5")
    cell.robot.behind = 0.03
    goal = cell.goal(moves(MH12, point(1.0, GOAL)), 1.3)
    assert goal.status is GoalStatus.executing
    cell.pass_time(0.5)
    assert (goal.status, goal.result.error_code) == (GoalStatus.aborted, -5)
    assert "after its last point the position of joint 'joint_1_s' is off by 0.03" in goal.result.error_string
    patient = cell.goal(moves(MH12, point(1.0, GOAL)), 2.0, goal_time_tolerance={"sec": 2})
    assert patient.status is GoalStatus.executing
    cell.robot.behind = 0.0
    cell.pass_time(0.1)
    assert patient.status is GoalStatus.succeeded


# Services and time


def test_stop_and_home(cell):
    cell.set(2.0, name=list(MH12), position=GOAL)
    cell.set(0.05, name=list(MH12), position=-GOAL)
    assert cell.call("stop").success
    here = cell.q
    cell.pass_time(1.0)
    np.testing.assert_array_equal(cell.q, here)
    assert cell.call("home").success
    cell.pass_time(2.0)
    np.testing.assert_allclose(cell.q, 0.0, atol=ROUNDING)


def test_the_motion_does_not_depend_on_how_often_the_node_is_let_work():
    ends = []
    for step in (0.001, 0.01, 0.3, 0.9):
        cell = Cell()
        cell.trajectory(moves(MH12, point(2.0, GOAL), point(4.0, -GOAL)))
        cell.network.advance(2.7, step=step)
        ends.append(cell.robot.read().q)
        assert not any("time has jumped" in line for line in cell.bus.lines)
    np.testing.assert_allclose(ends, [GOAL * (1 - 0.7)] * 4, atol=1e-9)


def test_time_is_caught_up_with_in_bounded_steps():
    cell = Cell()
    steps = []
    step = cell.robot.step
    cell.robot.step = lambda dt: (steps.append(dt), step(dt))[1]
    cell.pass_time(0.1)
    steps.clear()
    cell.network.advance(3600.0, step=3600.0)
    assert len(steps) == 50
    assert max(steps) <= 0.02
    assert cell.bus.lines[-1] == "time has jumped: by 3600.0 s; the arm goes on from where it was"


def test_simulated_time_drives_the_arm():
    network = FakeNetwork()
    bus, user = network.bus("controller", ["--ros-args", "-p", "use_sim_time:=true"]), network.bus("user")
    robot = KinematicSimulator(pieper.load("mh12").chain)
    Controller(bus, robot)
    clock = user.publisher("/clock", "rosgraph_msgs/msg/Clock")
    network.advance(1.0)
    user.publisher("joint_trajectory", JOINT_TRAJECTORY).send(moves(MH12, point(1.0, GOAL)))
    network.settle()
    network.advance(1.0)
    np.testing.assert_array_equal(robot.read().q, 0.0)  # the clock stands still
    for i in range(51):
        clock.send(clock=duration(1000.0 + 0.01 * i))
        network.settle()
    np.testing.assert_allclose(robot.read().q, GOAL / 2, atol=1e-2)
    clock.send(clock=duration(5.0))  # the simulation was begun anew
    network.settle()
    for i in range(61):
        clock.send(clock=duration(5.0 + 0.01 * i))
        network.settle()
    np.testing.assert_allclose(robot.read().q, GOAL, atol=ROUNDING)
    assert not bus.errors


@pytest.mark.parametrize(
    ("parameter", "reason"),
    [
        ("rate:=0.0", "must be from 1 to 1000, got 0.0"),
        ("max_points:=0", "must be from 1 to 1e"),
        ("goal_time:=-1.0", "must be from 0 to 3600"),
    ],
)
def test_parameters_are_checked(parameter, reason):
    with pytest.raises(pieper.errors.RosError, match=reason):
        Cell("mh12", parameter)


def test_on_every_network(network):
    """Command, trajectory and goal, one after the other, in real time where there is a real network."""
    bus, user = network.join("controller"), network.join("user")
    robot = KinematicSimulator(pieper.load("mh12").chain)
    Controller(bus, robot)
    heard = []
    user.subscribe("joint_states", JOINT_STATE, heard.append)
    command = user.publisher("set_joint_states", JOINT_STATE)
    trajectory = user.publisher("joint_trajectory", JOINT_TRAJECTORY)
    action = ActionClient(user, "follow_joint_trajectory", FOLLOW)
    assert network.until(lambda: action.ready and command.subscribers and trajectory.subscribers and bool(heard))

    def arrived(q):
        return lambda: bool(np.abs(heard[-1].position - q).max() < 1e-9)

    command.send(name=list(MH12), position=GOAL)
    assert network.until(arrived(GOAL))
    trajectory.send(moves(MH12, point(0.3, -GOAL)))
    assert network.until(arrived(-GOAL))
    goal = action.send({"trajectory": moves(MH12, point(0.3, GOAL))})
    assert network.until(lambda: goal.done)
    assert goal.status is GoalStatus.succeeded
    assert network.until(arrived(GOAL))
