"""`pieper ros`: the verbs, on a network inside this process whose time stands still when nobody works."""

from __future__ import annotations

import errno
import os
import re
import shlex
import subprocess
import sys
from importlib.util import find_spec

import numpy as np
import pytest
import yaml

import pieper
import pieper.ros
from pieper.cli import main as command
from pieper.cli.node import split
from pieper.errors import MissingExtraError, UnknownNameError
from pieper.ros import nodes
from pieper.ros.bags import Bag
from pieper.ros.fake import FakeNetwork

POINT = "geometry_msgs/msg/Point"
JOINTS = "sensor_msgs/msg/JointState"


class Network(FakeNetwork):
    """Where the commands of this test end up, and a node of the test itself."""

    def __init__(self):
        super().__init__()
        self.joined = []
        self.test = self.bus("test")

    def open_bus(self, node, *, arguments=(), backend=None, network=False, domain=None):
        bus = self.bus(node, arguments)
        self.joined.append((bus, {"backend": backend, "network": network, "domain": domain}))
        return bus

    def after(self, seconds, action):
        """Do something in a while, once."""

        def once():
            timer.cancel()
            action()

        timer = self.test.timer(seconds, once)

    def stop_after(self, seconds):
        self.after(seconds, lambda: self.joined[-1][0].stop())

    @property
    def lines(self):
        return self.joined[-1][0].lines


@pytest.fixture
def network(monkeypatch):
    network = Network()
    monkeypatch.setattr(pieper.ros, "open_bus", network.open_bus)
    return network


# Nodes


@pytest.mark.parametrize("entry", [e for e in nodes.NODES.values() if e.needs != "video"], ids=lambda e: e.name)
def test_every_node_starts_and_ends(pieper_command, network, entry):
    network.stop_after(0.5)
    result = pieper_command("ros", entry.name, *([] if entry.needs == "nothing" else ["mh12"]))
    assert (result.code, result.out, result.err) == (0, "", "")
    ((bus, options),) = network.joined
    assert options == {"backend": None, "network": False, "domain": None}
    assert not bus.errors
    assert bus not in network.buses, "the bus was not closed"


@pytest.mark.parametrize("entry", nodes.NODES.values(), ids=nodes.NODES)
def test_a_node_is_what_its_entry_says(entry):
    assert entry.load().__name__ == entry.kind
    assert nodes.find(entry.name) is entry
    assert entry.summary.endswith(".")
    assert len(entry.summary) < 50


def test_unknown_nodes_are_said(pieper_command):
    with pytest.raises(UnknownNameError, match=r"no node 'follower'; .*nodes are: forward, inverse"):
        nodes.find("follower")
    result = pieper_command("ros", "inverze")
    assert result.code == command.BAD_INPUT
    assert "no node 'inverze'; did you mean 'inverse'" in result.err


def test_list_names_every_node(pieper_command):
    result = pieper_command("ros", "list")
    assert result.code == 0
    for entry in nodes.NODES.values():
        assert f"pieper ros {entry.name}" in result.out
        assert entry.summary in result.out


def test_without_a_node_it_helps(pieper_command):
    result = pieper_command("ros")
    assert result.code == 0
    assert all(name in result.out for name in [*nodes.NODES, "record", "replay", "pub", "echo", "call", "list"])
    assert not any(line.endswith("...") for line in result.out.splitlines()[1:]), "a summary is too long for its line"


def test_parameters_behind_the_arm(pieper_command, network):
    network.stop_after(0.1)
    assert pieper_command("ros", "inverse", "mh12", "method:=report", "iterations:=7").code == 0
    parameters = network.joined[0][0].parameters
    assert parameters["method"].value == "report"
    assert parameters["iterations"].value == 7


def test_ros_arguments_arrive_untouched(pieper_command, network):
    network.stop_after(0.1)
    line = (
        "ros controller mh12 --domain 7 --ros-args -r __ns:=/cell2 -r set_joint_states:=/go -p rate:=50.0 -- --network"
    )
    assert pieper_command(*line.split()).code == 0
    ((bus, options),) = network.joined
    assert options == {"backend": None, "network": True, "domain": 7}
    assert bus.namespace == "/cell2"
    assert bus.parameters["rate"].value == 50.0
    assert bus.resolve("set_joint_states") == "/go"
    assert bus.resolve("joint_states") == "/cell2/joint_states"


def test_the_report_s_model_of_the_mh12_moves_the_robot(pieper_command, network):
    """Its five screws are no robot: with a controller and a description of their own nobody would understand the others."""
    network.stop_after(0.1)
    assert pieper_command("ros", "controller", "mh12-report").code == 0
    assert "Ready to move joint_1_s, joint_2_l, joint_3_u, joint_4_r, joint_5_b, joint_6_t" in network.lines[-1]
    said = []
    network.test.subscribe("robot_description", "std_msgs/msg/String", said.append)
    network.stop_after(0.1)
    assert pieper_command("ros", "description", "mh12-report").code == 0
    assert '<robot name="yaskawa_mh12">' in said[0].data


@pytest.mark.parametrize(
    ("line", "ours"),
    [
        ("mh12", "mh12"),
        ("mh12 --ros-args", "mh12"),
        ("--ros-args -r a:=b -- mh12", "mh12"),
        ("mh12 --ros-args -p x:=1 --ros-args -p y:=2", "mh12"),
        ("mh12 --ros-args -p x:=1 -- --tip tool0 --ros-args --log-level warn", "mh12 --tip tool0"),
        ("mh12 -- word", "mh12 -- word"),
    ],
)
def test_nothing_is_lost_between_us_and_ros(line, ours):
    mine, theirs = split(line.split())
    assert mine == ours.split()
    assert sorted([*mine, *theirs]) == sorted(line.split())


def test_an_arm_from_a_topic(pieper_command, network):
    text = network.test.publisher("robot_description", "std_msgs/msg/String", qos=pieper.ros.QoS(transient_local=True))
    from pieper.ros.nodes.description import urdf_text

    text.send(data=urdf_text("ur5e"))
    network.stop_after(0.5)
    assert pieper_command("ros", "ik_server", "topic:/robot_description").code == 0
    assert any("shoulder_pan_joint" in line for line in network.lines)


def test_an_arm_from_a_topic_that_is_silent(pieper_command, network):
    result = pieper_command("ros", "forward", "topic:/robot_description")
    assert result.code == command.BAD_INPUT
    assert "no robot description on /robot_description within 5 s" in result.err


def test_a_node_is_ended_while_it_waits_for_its_arm(pieper_command, network):
    network.stop_after(0.5)
    result = pieper_command("ros", "forward", "topic:/robot_description")
    assert (result.code, result.err) == (0, "")


def test_description_without_an_arm_passes_on_what_it_hears(pieper_command, network):
    heard = []
    network.test.subscribe("robot_description_latch", "std_msgs/msg/String", heard.append)
    publisher = network.test.publisher("robot_description", "std_msgs/msg/String")
    from pieper.ros.nodes.description import urdf_text

    network.after(0.2, lambda: publisher.send(data=urdf_text("ur5e")))
    network.stop_after(0.5)
    assert pieper_command("ros", "description").code == 0
    assert heard[-1].data == urdf_text("ur5e")


def test_description_of_a_file_is_the_file(pieper_command, network, tmp_path):
    from pieper.ros.nodes.description import urdf_text

    file = tmp_path / "mine.urdf"
    file.write_text("<!-- mine -->" + urdf_text("ur5e").partition("?>")[2])
    heard = []
    network.test.subscribe("robot_description", "std_msgs/msg/String", heard.append)
    network.stop_after(0.3)
    assert pieper_command("ros", "description", file).code == 0
    assert heard[-1].data == file.read_text()


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("ros forward", "name the arm: pieper ros forward mh12"),
        ("ros forward mh13", "did you mean 'mh12'"),
        ("ros forward mh12 ur5e", "got 'ur5e' behind the arm 'mh12'"),
        ("ros rotations mh12", "takes no arm"),
        ("ros description topic:/x", "without an arm passes on"),
        ("ros inverse mh12 metod:=report", "no parameter 'metod' in node 'inverse'; did you mean 'method'"),
        ("ros inverse mh12 method:=guess", "parameter 'method': "),
        ("ros inverse mh12 --ros-args -r x", "a remapping is written 'from:=to'"),
        ("ros inverse mh12 --ros-args --wat", "unknown ROS arguments: --wat"),
        ("ros inverse mh12 --wat", "No such option: --wat"),
    ],
)
def test_bad_input_is_one_sentence(pieper_command, network, line, complaint):
    result = pieper_command(*line.split())
    assert result.code == command.BAD_INPUT
    assert result.err.startswith("pieper: ")
    assert result.err.count("\n") == 1
    assert complaint in result.err
    assert all(bus.ok is False for bus, _ in network.joined)


def test_a_missing_extra_has_its_own_code(pieper_command, monkeypatch):
    def missing(*_, **__):
        raise MissingExtraError("cyclonedds", "ros", "the bare backend")

    monkeypatch.setattr(pieper.ros, "open_bus", missing)
    result = pieper_command("ros", "rotations")
    assert result.code == command.MISSING_PACKAGE
    assert "pip install 'pieper[ros]'" in result.err


@pytest.mark.parametrize("package", ["cyclonedds", "rosbags"])
def test_each_package_of_the_extra_is_named_when_it_is_missing(package):
    pytest.importorskip("cyclonedds", reason="cyclonedds, the first to be missed, is not installed")
    code = (
        "import sys\n"
        "from importlib.machinery import PathFinder\n"
        "class Without(PathFinder):\n"
        "    @classmethod\n"
        "    def find_spec(cls, name, *rest):\n"
        f"        return None if name.partition('.')[0] == {package!r} else PathFinder.find_spec(name, *rest)\n"
        "sys.meta_path[:] = [Without if finder is PathFinder else finder for finder in sys.meta_path]\n"
        "from pieper.cli.main import main\n"
        "sys.exit(main(['ros', 'rotations', '--backend', 'bare']))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60)
    assert result.returncode == command.MISSING_PACKAGE
    assert (
        result.stderr
        == f"pieper: {package} is not installed; a ROS 2 node without ROS needs it: pip install 'pieper[ros]'\n"
    )


def test_a_backend_that_is_not_there(pieper_command):
    result = pieper_command("ros", "rotations", "--backend", "zenoh")
    assert result.code == command.BAD_INPUT
    assert "no ROS backend 'zenoh'; backends are: rclpy, bare" in result.err
    if find_spec("rclpy") is None:
        result = pieper_command("ros", "rotations", "--backend", "rclpy")
        assert result.code == command.MISSING_PACKAGE
        assert "source your ROS 2 first" in result.err


# Topics and services


def test_pub_sends_once_when_somebody_listens(pieper_command, network):
    heard = []
    network.after(0.5, lambda: network.test.subscribe("target", POINT, heard.append))
    result = pieper_command("ros", "pub", "/target", POINT, "{x: 0.3, y: -1e-3, z: 2}", "--once")
    assert (result.code, result.err) == (0, "")
    network.settle()
    assert [(m.x, m.y, m.z) for m in heard] == [(0.3, -0.001, 2.0)]


def test_pub_repeats_at_its_rate(pieper_command, network):
    times = []
    network.test.subscribe("target", POINT, lambda _: times.append(network.time))
    assert pieper_command("ros", "pub", "target", "{x: 0.3}", "--rate", "20", "--times", "5").code == 0
    network.settle()
    np.testing.assert_allclose(np.diff(times), 0.05e9, atol=2e6)
    assert len(times) == 5


def test_pub_goes_on_until_it_is_ended(pieper_command, network):
    heard = []
    network.test.subscribe("target", POINT, heard.append)
    network.stop_after(3.5)
    assert pieper_command("ros", "pub", "target", "{}").code == 0
    assert len(heard) == 4


def test_pub_to_nobody(pieper_command, network):
    result = pieper_command("ros", "pub", "target", "{}", "--once", "--timeout", "0.5")
    assert result.code == 1
    assert "nobody listens to /target (geometry_msgs/msg/Point); waited 0.5 s" in result.err


def test_pub_latched(pieper_command, network):
    network.stop_after(0.5)
    network.after(
        0.3, lambda: network.test.subscribe("robot_description", "std_msgs/msg/String", heard.append, qos=latched)
    )
    heard, latched = [], pieper.ros.QoS(transient_local=True, depth=1)
    assert pieper_command("ros", "pub", "robot_description", "{data: <robot/>}").code == 0
    assert heard[-1].data == "<robot/>"


def speak(network, topic="joint_states", type_name=JOINTS, **fields):
    publisher = network.test.publisher(topic, type_name)
    network.test.timer(0.1, lambda: publisher.send(**fields))


def test_echo_prints_yaml(pieper_command, network):
    speak(network, name=["a", "b"], position=[0.5, float("nan")])
    result = pieper_command("ros", "echo", "joint_states", "--times", "2")
    assert (result.code, result.err) == (0, "")
    first, second, end = result.out.split("---\n")
    assert end == ""
    assert first == second
    fields = yaml.safe_load(first)
    assert list(fields) == ["header", "name", "position", "velocity", "effort"]
    assert fields["name"] == ["a", "b"]
    assert fields["position"][0] == 0.5


def test_echo_one_field(pieper_command, network):
    speak(network, position=[0.5], header={"frame_id": "base"})
    assert pieper_command("ros", "echo", "joint_states", "--once", "--field", "header.frame_id").out == "base\n---\n"
    assert pieper_command("ros", "echo", "joint_states", "--once", "--field", "position").out == "- 0.5\n---\n"


def test_echo_hears_sensors_and_everybody_else(pieper_command, network):
    publisher = network.test.publisher("odd", POINT, qos=pieper.ros.QoS(reliable=False))
    network.test.timer(0.1, lambda: publisher.send(x=1.0))
    assert pieper_command("ros", "echo", "odd", "geometry_msgs/Point", "--once").code == 0


def test_echo_into_a_pipe_that_closes(pieper_command, network, monkeypatch):
    class Closed:
        def write(self, _):
            raise BrokenPipeError(errno.EPIPE, "Broken pipe")

        def fileno(self):
            return unused

    unused = os.open(os.devnull, os.O_WRONLY)
    speak(network, position=[0.5])
    monkeypatch.setattr(sys, "stdout", Closed())
    result = pieper_command("ros", "echo", "joint_states")
    monkeypatch.undo()
    os.close(unused)
    assert (result.code, result.err) == (0, "")
    assert network.lines == []


def test_echo_of_silence(pieper_command, network):
    result = pieper_command("ros", "echo", "joint_states", "--timeout", "0.5")
    assert result.code == 1
    assert "no messages on /joint_states within 0.5 s" in result.err
    network.stop_after(0.2)
    assert pieper_command("ros", "echo", "joint_states").code == 0


def test_call_asks_and_prints_the_answer(pieper_command, network):
    network.test.serve("enable", "std_srvs/srv/SetBool", lambda request: {"success": request.data, "message": "fine"})
    result = pieper_command("ros", "call", "/enable", "std_srvs/srv/SetBool", "{data: true}")
    assert (result.code, result.err) == (0, "")
    assert yaml.safe_load(result.out) == {"success": True, "message": "fine"}


def test_call_without_a_server(pieper_command, network):
    result = pieper_command("ros", "call", "/enable", "std_srvs/SetBool", "--timeout", "0.5")
    assert result.code == 1
    assert "no server for /enable (std_srvs/srv/SetBool) within 0.5 s" in result.err


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("pub /weather '{}'", "the type of topic '/weather' is not known"),
        ("pub /target geometry_msgs/msg/Pointt '{}'", "did you mean 'geometry_msgs/msg/Point'"),
        ("pub /target our_msgs/msg/Thing '{}'", "no package 'our_msgs'"),
        ("pub /target Point '{}'", "as '{x: 0.3, y: 0.3}'"),
        ("pub /target Point", "'Point' is neither a type"),
        ("pub /target '{r: 1}'", "geometry_msgs/msg/Point has no field 'r'; its fields are: x, y, z"),
        ("pub /target '{x: one}'", "geometry_msgs/msg/Point.x must be a number"),
        ("pub /target '{x: 1'", "is not YAML"),
        ("pub /target '{1: 2}'", "'{name: value, ...}'"),
        ("pub /target '{}' --rate 0", "--rate takes a positive number"),
        ("pub /target '{}' --times 0", "--times takes a count from 1 on"),
        ("pub /target '{}' --qos lached", "no quality of service 'lached'"),
        ("pub 'two words' '{x: 1}' geometry", "expected a type and then all fields in one word"),
        ("echo /weather", "the type of topic '/weather' is not known"),
        ("echo /target --times 0", "--times takes a count from 1 on"),
        ("echo /target --field q", "geometry_msgs/msg/Point has no field 'q'; its fields are: x, y, z"),
        ("echo /target --field x.y", "geometry_msgs/msg/Point.x has no field 'y'; its fields are: none"),
        ("call /enable std_srvs/srv/SetBoll", "did you mean 'std_srvs/srv/SetBool_Request'"),
        ("call /enable std_srvs/srv/SetBool '{dada: true}'", "has no field 'dada'"),
        ("record /weather", "the type of topic '/weather' is not known"),
        ("record /target --storage zip", "no storage 'zip'"),
        ("replay nowhere", "there is no bag at nowhere"),
    ],
)
def test_bad_input_of_the_tools(pieper_command, network, line, complaint, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = pieper_command("ros", *shlex.split(line))
    assert result.code == command.BAD_INPUT
    assert result.out == ""
    assert result.err.count("\n") == 1
    assert complaint in result.err


# Bags


def test_record_and_replay(pieper_command, network, tmp_path):
    speak(network, "target", POINT, x=0.3)
    folder = tmp_path / "lab"
    result = pieper_command("ros", "record", "/target", "/odd:std_msgs/msg/String", "-o", folder, "--seconds", "1.05")
    assert result.code == 0
    assert re.search(r"10  /target\n +0  /odd\nwritten: .*lab\n", result.out)
    with Bag(folder) as bag:
        assert bag.topics["/target"].count == 10
    heard = []
    network.test.subscribe("/again", POINT, heard.append)
    result = pieper_command("ros", "replay", folder, "--rate", "2", "--ros-args", "-r", "/target:=/again")
    network.settle()
    assert (result.code, result.out) == (0, "10 messages sent\n")
    assert len(heard) == 10


def test_a_recording_that_is_ended_is_kept(pieper_command, network, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    speak(network, "target", POINT, x=0.3)
    network.stop_after(0.55)
    result = pieper_command("ros", "record", "/target")
    assert result.code == 0
    (folder,) = tmp_path.glob("bag_*")
    with Bag(folder) as bag:
        assert bag.count == 5
