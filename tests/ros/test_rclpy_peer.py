"""The bare backend among real ROS 2: it and rclpy hear each other, and the graph of ROS shows it as a node."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy", reason="no ROS 2 installation here")

import rclpy
from rclpy.context import Context

from pieper.ros import messages, open_bus
from pieper.ros.qos import LATCHED
from tests.ros.networks import Network

POINT = "geometry_msgs/msg/Point"
JOINT_STATE = "sensor_msgs/msg/JointState"
STRING = "std_msgs/msg/String"


@pytest.fixture
def network():
    network = Network("bare")
    yield network
    network.close()


@pytest.fixture
def nodes(network):
    """A node on bare DDS and a node on rclpy."""
    ours = network.join("arm")
    theirs = open_bus("planner", backend="rclpy", domain=network.domain)
    network.buses.append(theirs)
    yield {"bare": ours, "rclpy": theirs}
    theirs.close()


@pytest.fixture
def ros_graph(network):
    """What ``ros2 node`` and ``ros2 topic`` ask."""
    context = Context()
    rclpy.init(context=context, domain_id=network.domain)
    node = rclpy.create_node("looks_on", context=context)
    yield node
    node.destroy_node()
    rclpy.shutdown(context=context)


BOTH_WAYS = pytest.mark.parametrize(("sender", "listener"), [("bare", "rclpy"), ("rclpy", "bare")])


@BOTH_WAYS
def test_messages_of_rclpy_and_ours_are_the_same(network, nodes, sender, listener):
    heard: list = []
    subscription = nodes[listener].subscribe("joint_states", JOINT_STATE, heard.append)
    publisher = nodes[sender].publisher("joint_states", JOINT_STATE)
    assert network.until(lambda: publisher.subscribers == 1 and subscription.publishers == 1, seconds=10)
    message = messages.make(JOINT_STATE, header={"frame_id": "bäse"}, name=["a", "b"], position=[0.1, -2.0])
    publisher.send(message)
    assert network.until(lambda: heard)
    assert messages.as_fields(heard[0]) == messages.as_fields(message)


@BOTH_WAYS
def test_a_late_listener_gets_the_latched_description(network, nodes, sender, listener):
    heard: list = []
    nodes[sender].publisher("robot_description", STRING, qos=LATCHED).send(data="<robot/>")
    network.rest()
    nodes[listener].subscribe("robot_description", STRING, heard.append, qos=LATCHED)
    assert network.until(lambda: heard, seconds=10)
    assert heard[0].data == "<robot/>"


def test_the_graph_of_ros_shows_our_node_with_its_topics_types_and_services(network, ros_graph):
    bus = network.join("arm", "--ros-args", "-r", "__ns:=/cell")
    bus.publisher("tool_position", POINT)
    bus.subscribe("target", POINT, lambda message: None)
    assert network.until(lambda: ("arm", "/cell") in ros_graph.get_node_names_and_namespaces(), seconds=10)
    network.rest()
    assert dict(ros_graph.get_publisher_names_and_types_by_node("arm", "/cell"))["/cell/tool_position"] == [POINT]
    assert dict(ros_graph.get_subscriber_names_and_types_by_node("arm", "/cell"))["/cell/target"] == [POINT]
    (info,) = ros_graph.get_publishers_info_by_topic("/cell/tool_position")
    assert (info.node_name, info.node_namespace, info.topic_type) == ("arm", "/cell", POINT)
    assert str(info.topic_type_hash) == messages.type_hash(POINT)
    services = {name for name, _ in ros_graph.get_service_names_and_types_by_node("arm", "/cell")}
    verbs = ("get", "get", "set", "set", "list", "describe")
    nouns = ("parameters", "parameter_types", "parameters", "parameters_atomically", "parameters", "parameters")
    assert {f"/cell/arm/{verb}_{noun}" for verb, noun in zip(verbs, nouns, strict=True)} <= services
