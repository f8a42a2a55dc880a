"""The forward node against forward kinematics, the lines of the reports, and messages that nobody should send."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

import pieper
from pieper.errors import ArrayError, RosError
from pieper.kinematics.fk import fk
from pieper.model import catalog
from pieper.model.dh import forward_kinematics
from pieper.ros.fake import FakeNetwork
from pieper.ros.nodes import forward
from pieper.ros.nodes.forward import Forward, node_name
from pieper.ros.qos import LATCHED, SENSOR
from pieper.spatial.rotation import as_quaternion
from tests.robots import ROBOTS
from tests.ros.networks import Network
from tests.ros.nodes.users import MANY, POSE, User, as_matrix, frames_of, pose_in

GOLDEN = Path(__file__).parents[2] / "golden"
FIGURE_2 = yaml.safe_load((GOLDEN / "mh12_seed.yaml").read_text())["figure_2"]
UR = yaml.safe_load((GOLDEN / "ur_seed.yaml").read_text())["tcp_at_given_q"]
MH12_NAMES = ["joint_1_s", "joint_2_l", "joint_3_u", "joint_4_r", "joint_5_b", "joint_6_t"]
Q = np.array([0.3, -0.2, 0.4, 0.5, -0.6, 0.7])

ROUNDING = 2e-15  # [m, -] of a pose that went through a quaternion; the doubles travel as they are
COMPOSED = 1e-14  # the same after up to ten transforms
PRINTED = 1.1e-6  # [m, -]: six digits of the report, and of the line compared with it

TF = "tf2_msgs/msg/TFMessage"


def running(network, arm, *arguments, name=None):
    bus = network.join(name or node_name(arm), *arguments)
    return Forward(bus, arm), User(network)


@pytest.fixture
def fake():
    network = Network("fake")
    yield network
    errors = [error for bus in network.buses for error in bus.errors]
    network.close()
    assert not errors


# --- the pose


def test_the_pose_is_that_of_forward_kinematics(network):
    arm = pieper.load("mh12")
    _, user = running(network, arm)
    poses = user.hears("pose", POSE)
    user.joint_states(MH12_NAMES, Q, header={"stamp": {"sec": 12, "nanosec": 34}})
    assert network.until(lambda: poses)
    assert (poses[0].header.stamp.sec, poses[0].header.stamp.nanosec) == (12, 34)
    assert poses[0].header.frame_id == "base_link"
    np.testing.assert_allclose(as_matrix(poses[0].pose), arm.fk(Q), rtol=0, atol=ROUNDING)


def test_joint_states_without_a_stamp_get_one(network):
    _, user = running(network, pieper.load("mh12"))
    poses = user.hears("pose", POSE)
    before = user.bus.now()
    user.joint_states(MH12_NAMES, Q)
    assert network.until(lambda: poses)
    stamp = poses[0].header.stamp
    assert before <= stamp.sec * 10**9 + stamp.nanosec <= user.bus.now()


def test_namespace_and_remaps(network):
    arm = pieper.load("mh12")
    arguments = ("--ros-args", "-r", "__ns:=/cell2", "-r", "joint_states:=/robot/joints", "-r", "__node:=fk")
    bus = network.join("forward", *arguments)
    Forward(bus, arm)
    user = User(network)
    poses = user.hears("/cell2/pose", POSE)
    user.sends("/robot/joints", "sensor_msgs/msg/JointState", name=MH12_NAMES, position=Q)
    assert network.until(lambda: poses)
    assert user.log("cell2.fk")[0] == "Nodo PoE RRR iniciado. Suscrito a: /robot/joints"


def test_b4_name_and_first_line(network):
    node, user = running(network, pieper.load("mh12"))
    assert node._bus.node == "poe_mh12_node"
    assert user.log("poe_mh12_node") == ["Nodo PoE RRR iniciado. Suscrito a: /joint_states"]


def test_b4_a_queue_of_ten(fake):
    _, user = running(fake, pieper.load("mh12"))
    poses = user.hears("pose", POSE)
    for i in range(25):
        user.joint_states(MH12_NAMES, Q, header={"stamp": {"sec": i + 1}})
    fake.rest(0.01)
    assert [pose.header.stamp.sec for pose in poses] == list(range(16, 26))


@pytest.mark.parametrize(("reliable", "poses_heard"), [("true", 0), ("false", 1)])
def test_best_effort_joint_states_are_heard_where_that_is_asked_for(fake, reliable, poses_heard):
    _, user = running(fake, pieper.load("mh12"), "--ros-args", "-p", f"reliable:={reliable}")
    poses = user.hears("pose", POSE)
    sensor = fake.join("sensor").publisher("joint_states", "sensor_msgs/msg/JointState", qos=SENSOR)
    sensor.send(name=MH12_NAMES, position=Q)
    fake.rest(0.01)
    assert len(poses) == poses_heard


@pytest.mark.parametrize("order", [[3, 0, 5, 1, 4, 2], [5, 4, 3, 2, 1, 0]])
def test_b5_joints_are_matched_by_name(network, order):
    arm = pieper.load("mh12")
    _, user = running(network, arm)
    poses = user.hears("pose", POSE)
    names = ["gripper", *(MH12_NAMES[i] for i in order), "head"]
    user.joint_states(names, [9.0, *Q[order], 8.0])
    assert network.until(lambda: poses)
    np.testing.assert_allclose(as_matrix(poses[0].pose), arm.fk(Q), rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("name", ["mh12", "mh12-report"])
def test_b5_m6_without_names_the_positions_of_the_robot(fake, name):
    """Six positions are those of six joints: joint 4 is not taken for joint 5, though the report has five screws."""
    arm = pieper.load(name)
    _, user = running(fake, arm)
    poses = user.hears("pose", POSE)
    q = np.array([0.1, 0.2, 0.3, 0.0, -0.5, 0.6])
    user.joint_states([], q)
    user.joint_states(MH12_NAMES, q)
    assert fake.until(lambda: len(poses) == 2)
    expected = arm.fk(q) if name == "mh12" else arm.fk([0.1, 0.2, 0.3, 0.5, 0.6])
    for pose in poses:
        np.testing.assert_allclose(as_matrix(pose.pose), expected, rtol=0, atol=ROUNDING)


def test_m3_joint_5_is_inverted_for_the_screws_of_the_report(fake):
    """By the exact model the report's own screws are off by their constants alone, not by 0.2 m."""
    exact = pieper.load("mh12")
    _, user = running(fake, pieper.load("mh12-report"))
    poses = user.hears("pose", POSE)
    q = np.random.default_rng(3).uniform(-1.0, 1.0, (20, 6)) * [1, 1, 1, 0, 1, 1]
    for row in q:
        user.joint_states(MH12_NAMES, row)
        fake.rest(0.002)
    apart = [np.linalg.norm(as_matrix(p.pose)[:3, 3] - exact.fk(row)[:3, 3]) for p, row in zip(poses, q, strict=True)]
    assert 5e-5 < max(apart) < 5e-4  # requirements: never below 1e-4 m by much, at most 4.46e-4 m


def test_b6_lines(network):
    arm = pieper.load("mh12")
    _, user = running(network, arm, "--ros-args", "-p", "print_every:=0.0")
    q = [0.3, -0.2, 0.4, 0.0, -0.6, 0.7]
    user.joint_states(MH12_NAMES, q)
    assert network.until(lambda: len(user.log("poe_mh12_node")) == 3)
    T = arm.fk(q)
    (x, y, z), (qx, qy, qz, qw) = T[:3, 3], as_quaternion(T[:3, :3])
    assert user.log("poe_mh12_node")[1:] == [
        f"Posición: x={x:.6f}, y={y:.6f}, z={z:.6f}",
        f"Cuaternión: x={qx:.6f} y={qy:.6f} z={qz:.6f} w={qw:.6f}",
    ]


@pytest.mark.parametrize(
    "theta", [case["theta"] for case in FIGURE_2["solutions_seed_constants"]], ids=["one", "other"]
)
def test_b16_the_printed_pose_of_figure_2(network, theta):
    _, user = running(network, pieper.load("mh12-report"), "--ros-args", "-p", "print_every:=0.0")
    t1, t2, t3, t4, t5 = theta
    user.joint_states(MH12_NAMES, [t1, t2, t3, 0.0, -t4, t5])
    assert network.until(lambda: len(user.log("poe_mh12_node")) == 3)
    printed = [
        [float(word.partition("=")[2].rstrip(",")) for word in line.split()[1:]]
        for line in user.log("poe_mh12_node")[1:]
    ]
    np.testing.assert_allclose(printed[0], FIGURE_2["printed_position"], rtol=0, atol=PRINTED)
    np.testing.assert_allclose(printed[1], FIGURE_2["printed_quaternion_xyzw"], rtol=0, atol=PRINTED)


def test_a_changed_pose_is_printed_once_a_second(fake):
    _, user = running(fake, pieper.load("mh12"))
    for i in range(300):  # three seconds, half of it at rest
        user.joint_states(MH12_NAMES, Q + 1e-3 * min(i, 150))
        fake.rest(0.01)
    fake.rest(1.5)
    lines = [line for line in user.log("poe_mh12_node") if line.startswith("Posición")]
    assert 3 <= len(lines) <= 4
    x, y, z = pieper.load("mh12").fk(Q + 0.15)[:3, 3]
    assert lines[-1] == f"Posición: x={x:.6f}, y={y:.6f}, z={z:.6f}"


def test_every_pose_is_printed_when_asked_for(fake):
    _, user = running(fake, pieper.load("mh12"), "--ros-args", "-p", "print_every:=0.0")
    for _ in range(7):
        user.joint_states(MH12_NAMES, Q)
        fake.rest(0.001)
    assert len([line for line in user.log("poe_mh12_node") if line.startswith("Cuaternión")]) == 7


# --- what cannot be used


MALFORMED = [
    ([], [], "Mensaje JointState sin campos name/position válidos: both are empty"),
    (MH12_NAMES, [], "Mensaje JointState sin campos name/position válidos: 6 names and 0 positions"),
    (MH12_NAMES, [0.0] * 7, "Mensaje JointState sin campos name/position válidos: 6 names and 7 positions"),
    (MH12_NAMES, [0.0] * 5, "Mensaje JointState sin campos name/position válidos: 6 names and 5 positions"),
    (
        [*MH12_NAMES, "joint_2_l"],
        [0.0] * 7,
        "Mensaje JointState sin campos name/position válidos: joint 'joint_2_l' is named 2 times",
    ),
    (
        ["a", "b", "c"],
        [0.0] * 3,
        "JointState no contiene suficientes posiciones y no se encontraron nombres esperados: missing joint_1_s, joint_2_l",
    ),
    (
        MH12_NAMES[:5],
        [0.0] * 5,
        "JointState no contiene suficientes posiciones y no se encontraron nombres esperados: missing joint_6_t",
    ),
    (
        [],
        [0.0] * 5,
        "JointState no contiene suficientes posiciones y no se encontraron nombres esperados: 5 positions without names",
    ),
    (
        [],
        [0.0] * 7,
        "JointState no contiene suficientes posiciones y no se encontraron nombres esperados: 7 positions without names",
    ),
    (
        MH12_NAMES,
        [0.0, 0.0, np.nan, 0.0, 0.0, 0.0],
        "Error al evaluar fk_func: q must be finite, got q[2] = nan (joint 'joint_3_u')",
    ),
    (MH12_NAMES, [np.inf, 0.0, 0.0, 0.0, 0.0, 0.0], "Error al evaluar fk_func: q must be finite, got q[0] = inf"),
    (MH12_NAMES, [0.0, 1e300, 0.0, 0.0, 0.0, 0.0], "Error al evaluar fk_func: q must not exceed 1e+15"),
]


@pytest.mark.parametrize(
    ("names", "position", "reason"), MALFORMED, ids=lambda v: v[:60] if isinstance(v, str) else None
)
def test_b9_a_message_that_cannot_be_used(network, names, position, reason):
    arm = pieper.load("mh12")
    _, user = running(network, arm)
    poses = user.hears("pose", POSE)
    user.joint_states(names, position)
    assert network.until(lambda: len(user.log("poe_mh12_node")) == 2)
    assert user.log("poe_mh12_node")[1].startswith(reason)
    user.joint_states(MH12_NAMES, Q)  # the node is still there, and the pose before is not mixed into the next
    assert network.until(lambda: poses)
    assert len(poses) == 1
    np.testing.assert_allclose(as_matrix(poses[0].pose), arm.fk(Q), rtol=0, atol=ROUNDING)


def test_b9_a_matrix_that_is_no_rotation(fake, monkeypatch):
    """Forward kinematics gives none; the report has a line for it all the same."""

    def refuse(R):
        raise ArrayError("R must be a rotation")

    _, user = running(fake, pieper.load("mh12"))
    with monkeypatch.context() as patch:
        patch.setattr(forward, "quaternion_from_matrix", refuse)
        user.joint_states(MH12_NAMES, Q)
        fake.rest(0.01)
    assert user.log("poe_mh12_node")[1:] == ["Error al convertir matriz a cuaternión: R must be a rotation"]
    poses = user.hears("pose", POSE)
    user.joint_states(MH12_NAMES, Q)
    assert fake.until(lambda: poses)


def test_b9_no_flood(fake):
    _, user = running(fake, pieper.load("mh12"))
    for _ in range(1000):  # ten seconds
        user.joint_states(["a"], [0.0])
        user.joint_states([], [0.0])
        user.joint_states(MH12_NAMES, [np.nan] * 6)
        fake.rest(0.01)
    assert 15 <= len(user.log("poe_mh12_node")) <= 23  # two kinds, once a second each


JUNK = st.lists(st.sampled_from([*MH12_NAMES, "gripper", "", "é\n"]), max_size=9)
NUMBERS = st.lists(st.floats(width=64), max_size=9)


@settings(max_examples=200)
@given(names=st.one_of(JUNK, st.permutations(MH12_NAMES)), position=NUMBERS, velocity=NUMBERS)
def test_whatever_comes_the_pose_is_that_of_the_names_or_none(names, position, velocity):
    network, arm = FakeNetwork(), pieper.load("mh12")
    bus, user = network.bus("forward"), network.bus("user")
    Forward(bus, arm)
    poses, frames = [], []
    user.subscribe("pose", POSE, poses.append)
    user.subscribe("/tf", TF, frames.append)
    user.publisher("joint_states", "sensor_msgs/msg/JointState").send(name=names, position=position, velocity=velocity)
    network.settle()
    assert not bus.errors
    named = dict(zip(names or MH12_NAMES, position, strict=False))
    usable = len(position) == (len(names) or 6) and all((names or MH12_NAMES).count(n) == 1 for n in MH12_NAMES)
    q = np.array([named.get(name, np.nan) for name in MH12_NAMES])
    if usable and (np.abs(q) <= 1e15).all():
        np.testing.assert_allclose(as_matrix(poses[0].pose), arm.fk(q), rtol=0, atol=ROUNDING)
    else:
        assert not poses
        assert not frames
        assert len(bus.lines) == 2


def test_two_publishers_are_told_of_once(network):
    _, user = running(network, pieper.load("mh12"))
    other = User(network, "other")
    user.joint_states(MH12_NAMES, Q)
    network.rest(0.3)

    def told():
        return [line for line in user.log("poe_mh12_node") if "nodes publish" in line]

    assert not told()
    other.joint_states(MH12_NAMES, Q)
    assert network.until(told)
    for _ in range(5):
        user.joint_states(MH12_NAMES, Q)
        other.joint_states(MH12_NAMES, Q)
        network.rest(0.1)
    assert told() == ["2 nodes publish /joint_states: the pose jumps between what they say; stop all but one"]


# --- frames


@pytest.mark.parametrize("name", [robot.name for robot in ROBOTS])
def test_the_frames_on_tf_lead_to_every_link(fake, name):
    arm = pieper.load(name)
    joints = Forward(fake.join("forward"), arm)._joints
    user = User(fake)
    moving, fixed = user.hears("/tf", TF), user.hears("/tf_static", TF, LATCHED) if has_fixed(arm) else []
    q = np.clip(np.linspace(0.2, 0.5, arm.dof), *arm.limits.T)
    user.joint_states(joints.names, joints.write(q))
    assert fake.until(lambda: moving)
    frames = frames_of(fixed + moving)
    for frame, T in zip(arm.frame_names, arm.fk_frames(q), strict=True):
        np.testing.assert_allclose(pose_in(frames, frame, arm.base), T, rtol=0, atol=COMPOSED)


def has_fixed(arm):
    return any(joint.type == "fixed" for joint in arm.description.joints)


def test_c3_poses_of_link_6_and_of_the_gripper(network):
    """`tf_echo base_link link_6` and `tf_echo base_link gripper_link`."""
    arm = pieper.load("kr210")
    q = [0.1, 0.2, -0.3, 0.4, 0.5, -0.6]
    _, user = running(network, arm)
    moving, fixed = user.hears("/tf", TF), user.hears("/tf_static", TF, LATCHED)
    poses = user.hears("pose", POSE)
    user.joint_states(arm.joint_names, q)
    assert network.until(lambda: moving and fixed and poses)
    frames = frames_of(fixed + moving)
    for link in ("link_6", "gripper_link"):
        np.testing.assert_allclose(pose_in(frames, link, "base_link"), arm.fk(q, up_to=link), rtol=0, atol=COMPOSED)
    np.testing.assert_allclose(as_matrix(poses[0].pose), arm.fk(q), rtol=0, atol=ROUNDING)


def test_c3_the_pose_of_another_link_on_request(network):
    arm = pieper.load("kr210")
    q = [0.1, 0.2, -0.3, 0.4, 0.5, -0.6]
    _, user = running(network, arm, "--ros-args", "-p", "frame:=link_6")
    poses = user.hears("pose", POSE)
    user.joint_states(arm.joint_names, q)
    assert network.until(lambda: poses)
    np.testing.assert_allclose(as_matrix(poses[0].pose), arm.fk(q, up_to="link_6"), rtol=0, atol=ROUNDING)


YOUBOT_Q = np.array([1.0, 0.6, -1.2, 0.9, 2.0])


def youbot_frames(network, q):
    _, user = running(network, pieper.load("youbot"))
    moving = user.hears("/tf", TF)
    user.joint_states([f"arm_joint_{i}" for i in (5, 4, 3, 2, 1)], q[::-1])
    assert network.until(lambda: moving)
    return frames_of(moving)


def test_d7_frames_of_the_simplified_table(network):
    frames = youbot_frames(network, YOUBOT_Q)
    table = catalog.dh_tables("youbot")["simplified"]
    assert {name for name in frames if name.startswith("arm5b")} == {f"arm5b_link_{i}" for i in range(1, 6)}
    for i in range(1, 6):
        parent, T = frames[f"arm5b_link_{i}"]
        assert parent == "base_link"
        np.testing.assert_allclose(T, forward_kinematics(table, YOUBOT_Q, up_to_joint=i), rtol=0, atol=COMPOSED)


def test_d10_frames_of_the_full_table(network):
    frames = youbot_frames(network, YOUBOT_Q)
    table = catalog.dh_tables("youbot")["full"]
    for i in range(1, 6):
        parent, T = frames[f"arm5d_link_{i}"]
        assert parent == "base_link"
        np.testing.assert_allclose(T, forward_kinematics(table, YOUBOT_Q, up_to_joint=i), rtol=0, atol=COMPOSED)
    urdf = pieper.load("youbot").fk(YOUBOT_Q)
    np.testing.assert_allclose(frames["arm5d_link_5"][1], urdf, rtol=0, atol=1e-12)


def test_y5_one_transform_for_each_frame(network):
    node, user = running(network, pieper.load("youbot"))
    assert node._bus.node == "forward_kinematic_node"
    moving = user.hears("/tf", TF)
    user.joint_states([f"arm_joint_{i}" for i in range(1, 6)], YOUBOT_Q)
    assert network.until(lambda: moving)
    children = [t.child_frame_id for t in moving[0].transforms]
    assert len(children) == len(set(children)) == 5 + 10


HAND = """<?xml version="1.0"?>
<robot name="hand_on_a_rail">
  <link name="world"/><link name="cart"/><link name="arm"/><link name="tool0"/>
  <link name="palm"/><link name="left"/><link name="right"/>
  <joint name="rail" type="prismatic"><parent link="world"/><child link="cart"/>
    <origin xyz="0 0 0.1" rpy="0.1 0.2 0.3"/><axis xyz="0 1 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <joint name="turn" type="revolute"><parent link="cart"/><child link="arm"/>
    <origin xyz="0.1 0 0" rpy="0 0 1"/><axis xyz="1 0 1"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
  <joint name="mount" type="fixed"><parent link="arm"/><child link="tool0"/><origin xyz="0 0 0.2"/></joint>
  <joint name="hold" type="fixed"><parent link="arm"/><child link="palm"/><origin xyz="0 0.1 0" rpy="0 0 1"/></joint>
  <joint name="grip" type="prismatic"><parent link="palm"/><child link="left"/>
    <axis xyz="0 1 0"/><limit lower="0" upper="0.1" velocity="1" effort="1"/></joint>
  <joint name="grip_too" type="revolute"><parent link="palm"/><child link="right"/>
    <origin xyz="0 0 0.1"/><axis xyz="0 -1 0"/><mimic joint="grip" multiplier="-2" offset="0.3"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
</robot>"""


def hand_frames(fake, arm, names, position):
    Forward(fake.join("forward"), arm)
    user = User(fake)
    moving, fixed = user.hears("/tf", TF), user.hears("/tf_static", TF, LATCHED)
    user.joint_states(names, position)
    fake.rest(0.01)
    return frames_of(fixed + moving)


def test_links_beside_the_chain_and_joints_that_mimic(fake):
    arm = pieper.load(HAND, tip="tool0")
    frames = hand_frames(fake, arm, ["grip", "turn", "rail"], [0.04, 0.7, -0.2])
    for tip, q in (("tool0", [-0.2, 0.7]), ("left", [-0.2, 0.7, 0.04]), ("right", [-0.2, 0.7, 0.04])):
        expected = pieper.load(HAND, tip=tip).fk(q)
        np.testing.assert_allclose(pose_in(frames, tip, "world"), expected, rtol=0, atol=COMPOSED)


def test_a_joint_that_nobody_tells_of_has_no_frame(fake):
    frames = hand_frames(fake, pieper.load(HAND, tip="tool0"), ["turn", "rail"], [0.7, -0.2])
    assert sorted(frames) == ["arm", "cart", "palm", "tool0"]


def test_no_frames_with_a_finger_at_nan(fake):
    arm = pieper.load(HAND, tip="tool0")
    Forward(fake.join("forward"), arm)
    user = User(fake)
    moving, poses = user.hears("/tf", TF), user.hears("pose", POSE)
    user.joint_states(["turn", "rail", "grip"], [0.1, 0.2, np.nan])
    assert fake.until(lambda: poses)
    assert not moving
    assert "no transforms sent" in user.log("forward")[1]


def test_a_tool_and_a_base_that_were_added(fake):
    T_tool, T_base = pieper.load("ur5e").fk([0.1] * 6), pieper.load("ur5e").fk([0.2] * 6)
    arm = pieper.load("mh12").with_tool(T_tool, name="drill").with_base(T_base, name="hall")
    frames = hand_frames(fake, arm, MH12_NAMES, Q)
    np.testing.assert_allclose(pose_in(frames, "drill", "hall"), arm.fk(Q), rtol=0, atol=COMPOSED)


def test_an_arm_without_a_description_has_frames_too(fake):
    chain = pieper.load("ur5e").chain
    frames = hand_frames(fake, pieper.load(chain), chain.joint_names, Q)
    np.testing.assert_allclose(pose_in(frames, "tool0", "base_link"), fk(chain, Q), rtol=0, atol=COMPOSED)


def test_frames_can_be_left_to_another_node(fake):
    _, user = running(fake, pieper.load("mh12"), "--ros-args", "-p", "publish_tf:=false")
    poses = user.hears("pose", POSE)
    moving = []
    subscription = user.bus.subscribe("/tf", TF, moving.append, qos=MANY)
    user.joint_states(MH12_NAMES, Q)
    assert fake.until(lambda: poses)
    assert subscription.publishers == 0


# --- parameters


@pytest.mark.parametrize(
    ("argument", "reason"),
    [
        ("frame:=link_9", "no frame 'link_9' of 'yaskawa_mh12'; frames are: base_link, link_1_s"),
        ("print_every:=-1.0", "seconds must be at least 0 and finite, got -1.0"),
        ("queue:=0", "must be from 1 to 10000, got 0"),
    ],
)
def test_a_parameter_that_cannot_be(fake, argument, reason):
    with pytest.raises(RosError, match=reason):
        Forward(fake.join("forward", "--ros-args", "-p", argument), pieper.load("mh12"))


# --- the types of the UR course


@pytest.mark.parametrize("ur_type", sorted(UR["tool0"]))
def test_e1_e5_tcp_of_every_ur_type(fake, ur_type):
    arm = pieper.load(ur_type)
    _, user = running(fake, arm)
    poses = user.hears("pose", POSE)
    user.joint_states(arm.joint_names, UR["q"])
    assert fake.until(lambda: poses)
    T = as_matrix(poses[0].pose)
    wanted = UR["tool0"][ur_type]
    np.testing.assert_allclose(T[:3, 3], wanted["position"], rtol=0, atol=1e-12)
    q = poses[0].pose.orientation
    np.testing.assert_allclose([q.x, q.y, q.z, q.w], wanted["quaternion_xyzw"], rtol=0, atol=1e-12)
