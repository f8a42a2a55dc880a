"""The description on its topics, for early and for late subscribers, and arms that are loaded from there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

import pieper
from pieper.errors import RosError, UnknownNameError, UrdfError
from pieper.model.urdf import as_urdf
from pieper.ros.nodes.description import STRING, Description, arm_from_text, arm_from_topic, find_arm, urdf_text
from pieper.ros.nodes.forward import Forward
from pieper.ros.qos import DEFAULT, LATCHED
from tests.ros.networks import Network
from tests.ros.nodes.users import POSE, User, as_matrix

GOLDEN = Path(__file__).parents[2] / "golden"
UR = yaml.safe_load((GOLDEN / "ur_seed.yaml").read_text())["tcp_at_given_q"]
UR_TYPES = ["ur3", "ur3e", "ur5", "ur5e", "ur10", "ur10e", "ur16e", "ur20"]

AS_PRINTED = 1e-12  # [m, rad]: roll, pitch and yaw are written with as many digits as a double has


@pytest.fixture
def fake():
    network = Network("fake")
    yield network
    errors = [error for bus in network.buses for error in bus.errors]
    network.close()
    assert not errors


def serving(network, robot=None, *arguments):
    """A description node that works while `arm_from_topic` spins the other bus."""
    bus = network.join("description", *arguments)
    return Description(bus, robot)


def load_from(network, bus, **options):
    """`arm_from_topic`, with the other nodes of this process at work too."""
    others = [other for other in network.buses if other is not bus]
    spin_once = bus.spin_once

    def spin_all(timeout=None):
        for other in others:
            other.spin_once(0.0)
        spin_once(timeout)

    bus.spin_once = spin_all
    return arm_from_topic(bus, **options)


@pytest.mark.parametrize("ur_type", UR_TYPES)
def test_e1_every_ur_type_loads_from_the_topic(fake, ur_type):
    serving(fake, ur_type)
    arm = load_from(fake, fake.join("viewer"))
    T = arm.fk(UR["q"])
    np.testing.assert_allclose(T[:3, 3], UR["tool0"][ur_type]["position"], rtol=0, atol=AS_PRINTED)


def test_e2_late_subscribers_still_get_the_description(network):
    node = serving(network, "ur5e")
    network.rest(0.05)
    late = User(network, "late")
    for topic in ("/robot_description", "/robot_description_latch"):
        latched = late.hears(topic, STRING, LATCHED)
        assert network.until(lambda heard=latched: heard)
        assert latched[0].data == node.text


def test_e2_those_too_that_do_not_ask_for_latched_samples(network):
    node = serving(network, "ur5e", "--ros-args", "-p", "repeat:=0.2")
    network.rest(0.05)
    heard = User(network, "late").hears("/robot_description_latch", STRING, DEFAULT)
    assert network.until(lambda: heard, 2.0)
    assert heard[0].data == node.text


def test_e2_what_another_node_publishes_is_latched(network):
    """The course's topic_latcher: the description was sent once, to whoever was there."""
    serving(network)
    source = User(network, "source")
    text = urdf_text("ur5e")
    source.sends("robot_description", STRING, data=text)
    late = User(network, "late")
    heard = late.hears("/robot_description_latch", STRING, LATCHED)
    assert network.until(lambda: heard)
    assert heard[0].data == text
    assert "Latched the description of 'ur5e'" in late.log("description")


def test_e2_a_later_description_replaces_the_first(fake):
    node = serving(fake)
    source = User(fake, "source")
    for robot in ("ur5e", "mh12", "mh12"):
        source.sends("robot_description", STRING, data=urdf_text(robot))
        fake.rest(0.01)
    assert 'name="yaskawa_mh12"' in node.text
    assert len([line for line in source.log("description") if line.startswith("Latched")]) == 2


def test_repeating_can_be_turned_off(fake):
    serving(fake, "ur5e", "--ros-args", "-p", "repeat:=0.0")
    heard = User(fake, "late").hears("/robot_description_latch", STRING, LATCHED)
    fake.rest(5.0)
    assert len(heard) == 1


def test_e4_joint_names_in_order_from_text_with_an_encoding_header(network):
    text = urdf_text("ur5e").replace('<?xml version="1.0"?>', '<?xml version="1.0" encoding="utf-8"?>')
    assert 'encoding="utf-8"' in text
    serving(network, text)
    arm = load_from(network, network.join("ur_controller"), tip="tool0")
    assert arm.joint_names == (
        "shoulder_pan_joint",
        "shoulder_lift_joint",
        "elbow_joint",
        "wrist_1_joint",
        "wrist_2_joint",
        "wrist_3_joint",
    )
    assert repr(arm) == "Arm('ur5e', 6 joints, 'base_link' -> 'tool0')"
    assert arm.tip == "tool0"


def test_e5_tcp_of_the_arm_from_the_topic(network):
    serving(network, "ur5e")
    bus = network.join("forward")
    arm = load_from(network, bus)
    Forward(bus, arm)
    user = User(network)
    poses = user.hears("pose", POSE)
    user.joint_states(arm.joint_names, UR["q"])
    assert network.until(lambda: poses)
    T = as_matrix(poses[0].pose)
    np.testing.assert_allclose(T[:3, 3], (0.224996413, -0.283120100, 0.589463254), rtol=0, atol=5e-10)
    q = poses[0].pose.orientation
    wanted = (0.144568002, -0.988719338, -0.039167378, 0.000283741)
    np.testing.assert_allclose([q.x, q.y, q.z, q.w], wanted, rtol=0, atol=6e-10)


@pytest.mark.parametrize("name", ["mh12", "kr210", "youbot", "panda", "mh12-report"])
def test_an_arm_comes_over_the_network_as_it_is(fake, name):
    serving(fake, name)
    arm, original = load_from(fake, fake.join("forward")), pieper.load(name)
    assert (arm.joint_names, arm.base, arm.tip) == (original.joint_names, original.base, original.tip)
    np.testing.assert_allclose(arm.chain.screws, original.chain.screws, rtol=0, atol=AS_PRINTED)
    np.testing.assert_allclose(arm.chain.home, original.chain.home, rtol=0, atol=AS_PRINTED)
    np.testing.assert_array_equal(arm.limits, original.limits)


# --- where a description comes from


def test_a_urdf_file_is_published_as_it_is(fake, tmp_path):
    text = as_urdf(pieper.load("ur5e").chain).replace("</robot>", "  <!-- kept --> <gazebo/>\n</robot>")
    file = tmp_path / "arm.urdf"
    file.write_text(text, encoding="utf-8")
    assert serving(fake, file).text == text
    assert serving(fake, str(file)).text == text
    assert serving(fake, text).text == text


def test_a_urdf_file_in_another_encoding_is_written_in_that_of_messages(fake, tmp_path):
    text = urdf_text("ur5e").partition("\n")[2]
    file = tmp_path / "arm.urdf"
    file.write_bytes(
        f"<?xml version='1.0' encoding='iso-8859-1'?>\n<!-- brazo del año -->\n{text}".encode("iso-8859-1")
    )
    node = Description(fake.join("description"), str(file))
    assert "iso-8859-1" not in node.text
    assert arm_from_text(node.text, source="here").joint_names == pieper.load("ur5e").joint_names


def test_an_arm_without_a_description_is_written_as_one(fake):
    chain = pieper.load("ur5e").chain
    node = serving(fake, pieper.load(chain))
    arm = arm_from_text(node.text, source="text", tip="tool0")
    np.testing.assert_allclose(arm.chain.screws, chain.screws, rtol=0, atol=AS_PRINTED)


def test_a_mesh_that_is_not_there_is_told_and_does_no_harm(fake):
    text = urdf_text("ur5e").replace(
        '<link name="tool0"/>',
        '<link name="tool0"><visual><geometry><mesh filename="package://nowhere/a.stl"/></geometry></visual></link>',
    )
    assert "nowhere" in text
    serving(fake, text)
    user = User(fake)
    assert [line for line in user.log("description") if "nowhere" in line]
    assert load_from(fake, fake.join("viewer")).dof == 6


def test_no_such_robot(fake):
    with pytest.raises(UnknownNameError, match="did you mean 'ur5e'"):
        serving(fake, "ur5ee")


def test_an_arm_by_name_or_from_a_topic(fake):
    assert find_arm(fake.join("one"), "mh12").name == "yaskawa_mh12"
    with pytest.raises(RosError, match=r"no robot description on /robot/text within 0\.2 s; start the node"):
        find_arm(fake.join("two"), "topic:/robot/text", timeout=0.2)


# --- what is no description

NO_URDF = [
    ("", "document: is not a URDF, which starts with <: it starts with ''"),
    ("hello", "document: is not a URDF, which starts with <: it starts with 'hello'"),
    ("/etc/hostname", "document: is not a URDF, which starts with <: it starts with '/etc/hostname'"),
    ("<robot", "is not well-formed XML"),
    ("<html><body/></html>", "robot"),
    ("<robot name='r'/>", "links"),
    ("<!DOCTYPE robot [<!ENTITY a 'b'>]><robot name='r'><link name='a'/></robot>", "<!DOCTYPE> is refused"),
    (
        "<robot name='r' xmlns:xacro='http://ros.org/wiki/xacro'><xacro:property name='p' value='${1+1}'/></robot>",
        "document: is xacro, which can run programs and is not expanded here; publish the URDF",
    ),
    ("<robot name='r'>" + "<link name='a'/>" * 3 + "</robot>", "twice"),
]


@pytest.mark.parametrize(("text", "reason"), NO_URDF, ids=[text[:24] for text, _ in NO_URDF])
def test_a_text_that_is_no_urdf_is_refused_with_the_reason(fake, text, reason):
    source = fake.join("source")
    source.publisher("robot_description", STRING, qos=LATCHED).send(data=text)
    with pytest.raises(UrdfError) as caught:
        load_from(fake, fake.join("viewer"), timeout=1.0)
    assert reason in str(caught.value)
    assert str(caught.value).startswith("/robot_description: ")


def test_a_text_that_is_no_urdf_is_not_latched(network):
    node = serving(network)
    source = User(network, "source")
    for _ in range(20):
        source.sends("robot_description", STRING, data="no description")
    assert network.until(lambda: source.log("description"))
    assert node.text == ""
    refused = source.log("description")
    assert refused[0].startswith("description refused: robot_description: document: is not a URDF")
    assert len(refused) == 1
    source.sends("robot_description", STRING, data=urdf_text("ur5e"))
    assert network.until(lambda: node.text)
