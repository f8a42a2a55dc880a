"""The bare backend among real ROS 2: it and rclpy hear each other, and the graph of ROS shows it as a node."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy", reason="no ROS 2 installation here")

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

import pieper
from pieper.ros import messages, open_bus
from pieper.ros.nodes.forward import Forward
from pieper.ros.nodes.inverse import Inverse
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


class Team:
    """A node that a team has written with rclpy."""

    def __init__(self, network):
        self.context = Context()
        rclpy.init(context=self.context, domain_id=network.domain)
        self.node = rclpy.create_node("team", context=self.context)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._network = network

    def until(self, condition, seconds=10.0):
        """Let it and ours work until the condition holds."""

        def look():
            self._executor.spin_once(timeout_sec=0.0)
            return condition()

        return self._network.until(look, seconds)

    def close(self):
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def team(network):
    team = Team(network)
    yield team
    team.close()


BOTH = pytest.mark.parametrize("backend", ["bare", "rclpy"])


def join(network, node, backend, *arguments):
    bus = open_bus(node, backend=backend, domain=network.domain, arguments=arguments)
    network._stack.callback(bus.close)
    network.buses.append(bus)
    return bus


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


@BOTH
def test_joint_states_of_rclpy_become_poses(network, team, backend):
    arm = pieper.load("mh12")
    Forward(join(network, "forward", backend, "--ros-args", "-p", "publish_tf:=false"), arm)
    poses: list = []
    team.node.create_subscription(PoseStamped, "/pose", poses.append, 10)
    publisher = team.node.create_publisher(JointState, "/joint_states", 10)
    assert team.until(lambda: publisher.get_subscription_count() and team.node.count_publishers("/pose"))
    message = JointState(name=[*reversed(arm.joint_names), "gripper"], position=[0.0] * 5 + [0.5, 0.1])

    def heard():
        publisher.publish(message)
        return bool(poses)

    assert team.until(heard)
    place = poses[-1].pose.position
    assert (place.x, place.y, place.z) == pytest.approx(arm.fk([0.5, 0, 0, 0, 0, 0])[:3, 3], abs=1e-12)
    assert poses[-1].header.frame_id == arm.base


@BOTH
def test_time_of_rclpy_is_ours(network, team, backend):
    bus = join(network, "node", backend, "--ros-args", "-p", "use_sim_time:=true")
    bus.timer(0.01, lambda: None)
    publisher = team.node.create_publisher(Clock, "/clock", 1)
    assert team.until(lambda: publisher.get_subscription_count() > 0)
    clock = Clock()
    clock.clock.sec = 77

    def told():
        publisher.publish(clock)
        return bus.now() == 77 * 10**9

    assert team.until(told)


def test_parameters_are_asked_for_and_set_by_rclpy(network, team):
    bus = join(network, "arm", "rclpy")
    rate = bus.parameter("rate", 10.0)
    client = AsyncParameterClient(team.node, "/arm")
    assert team.until(client.services_are_ready)

    def answer(future):
        assert team.until(future.done)
        return future.result()

    assert list(answer(client.list_parameters([], 10)).result.names) == ["rate", "use_sim_time"]
    assert answer(client.get_parameters(["rate"])).values[0].double_value == 10.0
    given = [Parameter("rate", value=20.0), Parameter("rate", value="fast")]
    results = answer(client.set_parameters(given)).results
    assert [result.successful for result in results] == [True, False]
    assert rate.value == 20.0


def test_the_graph_shows_a_bare_node_as_one_on_rclpy(network, ros_graph):
    """Topics, types, hashes and quality of service of the same node on both backends."""
    for backend in ("bare", "rclpy"):
        Inverse(join(network, f"on_{backend}", backend), pieper.load("mh12"))

    def seen(backend, topic):
        ends = [*ros_graph.get_publishers_info_by_topic(topic), *ros_graph.get_subscriptions_info_by_topic(topic)]
        return {
            (
                end.endpoint_type,
                end.topic_type,
                str(end.topic_type_hash),
                end.qos_profile.reliability,
                end.qos_profile.durability,
                end.qos_profile.lifespan.nanoseconds,
                end.qos_profile.deadline.nanoseconds,
                end.qos_profile.liveliness,
            )
            for end in ends
            if end.node_name == f"on_{backend}"
        }

    topics = {"/joint_states": 2, "/target": 1, "/joint_trajectory": 1, "/rosout": 1, "/parameter_events": 1}
    for topic, ends in topics.items():
        assert network.until(lambda t=topic, n=ends: len(seen("bare", t)) == len(seen("rclpy", t)) == n, seconds=10)
        assert seen("bare", topic) == seen("rclpy", topic)


@BOTH
def test_joint_states_of_sensor_quality_are_heard_where_that_is_asked_for(network, team, backend):
    arm = pieper.load("mh12")
    arguments = ("--ros-args", "-p", "publish_tf:=false", "-p", "reliable:=false")
    Forward(join(network, "forward", backend, *arguments), arm)
    Inverse(join(network, "inverse", backend, "--ros-args", "-p", "reliable:=false"), arm)
    sensor = team.node.create_publisher(JointState, "/joint_states", qos_profile_sensor_data)
    assert team.until(lambda: sensor.get_subscription_count() == 2)
