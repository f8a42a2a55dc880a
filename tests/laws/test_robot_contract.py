"""One interface, three robots: without mass, with mass, and on a ROS network. What one can be asked, all can, with the same outcome."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import pieper
from pieper.errors import ArrayError, MotionError, PieperError, RosError, UnknownNameError
from pieper.ik.iteration import iterate
from pieper.ros.fake import FakeNetwork
from pieper.ros.nodes.controller import Controller
from pieper.ros.robot import RosRobot
from pieper.sim.kinematic import KinematicSimulator

UR_GOAL = np.array([-1.28, 4.41, 1.54, -1.16, -1.56, 0.0])
ARRIVED = {"kinematic": 1e-9, "physics": 2e-4, "ros": 1e-9}  # [rad]; drives of an arm with mass sag by that
BEYOND = {"kinematic": 0.0, "physics": 1e-3, "ros": 0.0}  # [rad] of a joint limit, as measured
AT_REST = {"kinematic": 0.0, "physics": 2e-3, "ros": 0.0}  # [rad/s]
PERIOD = 0.01  # [s]
JOINT_SPEED = 1.02  # of the limit, as measured: drives run a little ahead while they catch up
T_LINK_6_GRIPPER = np.eye(4)
T_LINK_6_GRIPPER[0, 3] = 0.11  # [m] of the KR210


class Simulated:
    """A robot whose time the test moves on."""

    def __init__(self, kind, name):
        self.kind, self.arm = kind, pieper.load(name)
        if kind == "kinematic":
            self.robot = KinematicSimulator(self.arm.chain)
        elif kind == "physics":
            pytest.importorskip("mujoco", reason="mujoco is not installed")
            from pieper.sim.physics import MujocoSimulator
            from pieper.sim.scene import Scene

            self.robot = MujocoSimulator(self.arm, scene=Scene(floor=None))
            self.robot.model.geom_contype[:] = self.robot.model.geom_conaffinity[:] = (
                0  # links that cross are not of interest
            )
        else:
            self.network = FakeNetwork()
            self.node = Controller(self.network.bus("controller"), KinematicSimulator(self.arm.chain))
            self.robot = RosRobot(self.network.bus("user"), self.arm.chain)
            self.network.advance(0.05, step=PERIOD)

    def advance(self, seconds):
        """Let time pass; the states read meanwhile."""
        states = []
        for _ in range(round(seconds / PERIOD)):
            if self.kind == "ros":
                self.network.advance(PERIOD, step=PERIOD)
            else:
                self.robot.step(PERIOD)
            states.append(self.robot.read())
        return states


@pytest.fixture(params=["kinematic", "physics", "ros"])
def kind(request):
    return request.param


def held(cell, states):
    lower, upper = cell.arm.limits.T
    q, dq = np.array([s.q for s in states]), np.array([s.dq for s in states])
    assert (q >= lower - BEYOND[cell.kind]).all()
    assert (q <= upper + BEYOND[cell.kind]).all()
    assert (np.abs(dq) <= JOINT_SPEED * (1.0 + 1e-6) * cell.robot.limits.velocity).all()


def test_E3_the_arm_of_the_report_goes_to_its_joint_values(kind):
    cell = Simulated(kind, "ur5e")
    cell.robot.command(UR_GOAL)
    held(cell, cell.advance(6.0))
    np.testing.assert_allclose(cell.robot.read().q, UR_GOAL, atol=ARRIVED[kind])
    assert np.abs(cell.robot.read().dq).max() <= AT_REST[kind]
    T = cell.arm.fk(cell.robot.read().q)
    np.testing.assert_allclose(T[:3, 3], [0.224996413, -0.283120100, 0.589463254], atol=1e-9 + ARRIVED[kind])


def test_E4_the_six_joint_names_in_order_from_text_with_an_encoding_header(kind):
    cell = Simulated(kind, "ur5e")
    assert cell.robot.joint_names == (
        "shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint",
    )  # fmt: skip
    cell.robot.command({"elbow_joint": 1.0, "wrist_3_joint": -0.5})
    cell.advance(3.0)
    np.testing.assert_allclose(cell.robot.read().q, [0.0, 0.0, 1.0, 0.0, 0.0, -0.5], atol=ARRIVED[kind])


def test_E6_the_steps_of_the_jacobian_loop_move_the_arm_to_the_target(kind):
    """Each step is a command from what was read; with k1 = 1 it takes 4, and the arm has arrived after the last."""
    cell = Simulated(kind, "ur5e")
    cell.robot.command(UR_GOAL)
    cell.advance(6.0)
    target = np.array([0.5, -0.6, 0.2])
    count = 0
    while count < 20:
        here = cell.robot.read().q
        tip = cell.arm.fk(here)[:3, 3]
        if np.linalg.norm(target - tip) < 1e-3:
            break
        *_, step = iterate(cell.arm.chain, target, here, orientation="hold", k1=1.0, iterations=1)
        cell.robot.command(step.q)
        held(cell, cell.advance(4.0))
        count += 1
    assert count == 4
    assert np.linalg.norm(cell.arm.fk(cell.robot.read().q)[:3, 3] - target) < 1e-3


def test_C3_poses_of_link_6_and_of_the_gripper_while_the_arm_moves(kind):
    """What is read at every moment gives the poses; where the physics is asked, it has its own opinion of the tip."""
    cell = Simulated(kind, "kr210")
    cell.robot.command([0.4, 0.3, -0.2, 0.5, -0.6, 0.7])
    seen = []
    for _ in range(10):
        cell.advance(0.1)
        T_link_6, T_gripper = cell.arm.fk_frames(cell.robot.read().q, frames=["link_6", "gripper_link"])
        np.testing.assert_allclose(np.linalg.inv(T_link_6) @ T_gripper, T_LINK_6_GRIPPER, atol=1e-12)
        seen.append(T_gripper[:3, 3])
        if kind == "physics":
            import mujoco

            mujoco.mj_kinematics(cell.robot.model, cell.robot.data)
            np.testing.assert_allclose(cell.robot.data.site("tip").xpos, T_gripper[:3, 3], atol=1e-9)
    assert np.linalg.norm(np.diff(seen, axis=0), axis=1).max() > 0.01  # it did move


@pytest.mark.parametrize(
    ("q", "error", "words"),
    [
        ([0.0] * 5, ArrayError, "q must have shape"),
        ([0.0, np.nan, 0.0, 0.0, 0.0, 0.0], ArrayError, "finite"),
        ([0.0, 9.0, 0.0, 0.0, 0.0, 0.0], MotionError, "joint 'shoulder_lift_joint' at 9 rad is outside its limits"),
        ({"elbow": 1.0}, UnknownNameError, "no joint 'elbow'"),
        ({"elbow_joint": "bent"}, ArrayError, "must be a number, got 'bent'"),
    ],
)
def test_what_must_not_be_carried_out_changes_nothing(kind, q, error, words):
    cell = Simulated(kind, "ur5e")
    cell.robot.command({"elbow_joint": 0.5})
    cell.advance(0.2)
    with pytest.raises(error, match=words):
        cell.robot.command(q)
    cell.advance(3.0)
    np.testing.assert_allclose(cell.robot.read().q, [0.0, 0.0, 0.5, 0.0, 0.0, 0.0], atol=ARRIVED[kind])


@settings(max_examples=12, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(moment=st.floats(0.0, 2.5), again=st.booleans(), seed=st.integers(0, 1000))
def test_stopped_at_any_moment_the_arm_rests_within_its_limits(kind, moment, again, seed):
    cell = Simulated(kind, "ur5e")
    lower, upper = np.clip(cell.arm.limits, -3.0, 3.0).T
    goals = np.random.default_rng(seed).uniform(lower, upper, (2, 6))
    cell.robot.command(goals[0])
    states = cell.advance(0.5 * moment)
    if again:  # another command, into the motion
        cell.robot.command(goals[1])
    states += cell.advance(0.5 * moment)
    cell.robot.stop()
    states += cell.advance(1.5)
    held(cell, states)
    rest = cell.advance(0.5)
    assert np.abs([s.dq for s in rest]).max() <= AT_REST[kind]
    assert np.ptp([s.q for s in rest], axis=0).max() <= AT_REST[kind]


# --------------------------------------------------------------------------------------------------------------------
# on a network


def test_an_arm_that_is_not_heard_cannot_be_read_or_commanded():
    chain, network = pieper.load("mh12").chain, FakeNetwork()
    bus = network.bus("user")
    robot = RosRobot(bus, chain)
    with pytest.raises(RosError, match=r"no joint states of joint_1_s, .* on the network yet: none have been heard"):
        robot.read()
    with pytest.raises(PieperError, match="on the network yet"):
        robot.command([0.0] * 6)
    with pytest.raises(RosError, match=r"in 0.2 s"):
        robot.wait_until_heard(timeout=0.2)
    states = network.bus("gripper").publisher("joint_states", "sensor_msgs/msg/JointState")
    states.send(name=["finger"], position=[0.1])
    network.settle()
    with pytest.raises(RosError, match="a message lacks joint_1_s"):
        robot.read()
    names = list(chain.joint_names)
    states.send(name=names, position=[np.nan] * 6)
    network.settle()
    with pytest.raises(RosError, match="one finite position for each name"):
        robot.read()
    states.send(
        name=[*names[::-1], "finger"], position=[0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 9.0]
    )  # in any order, with others
    robot.wait_until_heard()
    np.testing.assert_array_equal(robot.read().q, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    assert not robot.read().dq.any()
    network.advance(1.5)
    with pytest.raises(RosError, match="is the robot still there"):
        robot.read()
