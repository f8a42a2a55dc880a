import contextlib
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pieper.errors import RosError
from pieper.ros.arguments import matches, parse, read_parameters, read_value
from pieper.ros.names import Remap


def read(line, node="inverse"):
    return parse(line.split(), node_name=node)


def test_without_ros_arguments_everything_is_left_over():
    found = read("mh12 --rate 50 -r x")
    assert found.rest == ["mh12", "--rate", "50", "-r", "x"]
    assert (found.node, found.namespace, found.remaps, found.parameters, found.log_level) == (None, None, (), {}, None)


def test_what_is_around_the_ros_arguments_is_left_over():
    found = read("mh12 --ros-args -r a:=b -- --flag --ros-args -r c:=d")
    assert found.rest == ["mh12", "--flag"]
    assert found.remaps == (Remap("a", "b"), Remap("c", "d"))


def test_name_and_namespace():
    for name in ("__node", "__name"):
        found = read(f"--ros-args -r {name}:=left --remap __ns:=/cell2")
        assert (found.node, found.namespace) == ("left", "/cell2")
    found = read("--ros-args -r forward:__ns:=/a -r inverse:__ns:=/b -r __ns:=/c")
    assert found.namespace == "/b"


def test_parameters_of_the_command_line_later_ones_win():
    found = read("--ros-args -p rate:=50.0 --param rate:=20 -p inverse:name:=mh12 -p forward:other:=1 -p empty:=")
    assert found.parameters == {"rate": 20, "name": "mh12", "empty": ""}


def test_a_value_may_hold_the_separator():
    assert read("--ros-args -p expression:=a:=b").parameters == {"expression": "a:=b"}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("true", True),
        ("Off", False),
        ("y", True),
        ("50", 50),
        ("-5", -5),
        ("0x1F", 31),
        ("010", 8),
        ("1e-9", 1e-9),
        ("1.", 1.0),
        (".5", 0.5),
        ("-.inf", float("-inf")),
        ("12:30", "12:30"),
        ("2026-11-23", "2026-11-23"),
        ("1_000", "1_000"),
        ("/a/b", "/a/b"),
        ("'50'", "50"),
        ("~/state", "~/state"),
        ("[1, 2]", [1, 2]),
        ("[1, 2.5]", [1.0, 2.5]),
        ("[true, false]", [True, False]),
        ("[a, b]", ["a", "b"]),
        ("[]", []),
    ],
)
def test_values_are_read_as_rcl_reads_them(text, value):
    found = read_value(text)
    assert found == value
    assert type(found) is type(value)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_float_reads_back(number):
    assert read_value(repr(number)) == number


@given(st.integers(-(2**63), 2**63 - 1))
def test_every_integer_reads_back(number):
    assert read_value(str(number)) == number


@pytest.mark.parametrize("text", ["null", "{a: 1}", "[1, a]", "[1, true]", "[[1]]", "[null]"])
def test_values_of_no_parameter_type(text):
    with pytest.raises(RosError, match=r"must be a (boolean, a number, text|list of values of one type)"):
        read_value(text)


@pytest.mark.parametrize("text", ["[1", "!!python/object/apply:os.system [ls]", "a: b: c", "[" * 5000])
def test_what_is_not_yaml_or_not_safe_is_an_error(text):
    with pytest.raises(RosError, match="is not YAML"):
        read_value(text)


@given(st.text(max_size=30))
def test_any_text_is_a_value_or_an_error(text):
    with contextlib.suppress(RosError):
        assert isinstance(read_value(text), bool | int | float | str | list)


def test_log_level():
    assert read("--ros-args --log-level debug").log_level == "debug"
    assert read("--ros-args --log-level WARN").log_level == "warn"
    assert read("--ros-args --log-level inverse:=error").log_level == "error"
    assert read("--ros-args --log-level rcl:=error").log_level is None
    with pytest.raises(RosError, match="takes one of debug, info, warn, error, fatal, got 'loud'"):
        read("--ros-args --log-level loud")


def test_arguments_that_are_accepted_and_have_no_effect():
    found = read("--ros-args -e /secure --enclave /x --disable-rosout-logs --enable-stdout-logs --log-config-file f")
    assert found == read("--ros-args")


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("--ros-args --speed --fast", "unknown ROS arguments: --speed --fast; known are -r, --remap"),
        ("--ros-args mh12", "come before --ros-args or behind --"),
        ("--ros-args -r", "-r needs a value behind it"),
        ("--ros-args -p --", "-p needs a value behind it"),
        ("--ros-args -p rate", "written 'name:=value' or 'node:name:=value', got 'rate'"),
        ("--ros-args -p :rate:=1", "written 'name:=value'"),
        ("--ros-args -r target", "written 'from:=to'"),
        ("--ros-args --params-file /no/such/file", "cannot read the parameters file '/no/such/file'"),
    ],
)
def test_what_is_not_well_written(line, reason):
    with pytest.raises(RosError, match=re.escape(reason)):
        read(line)


@pytest.mark.parametrize(
    ("pattern", "node", "fits"),
    [
        ("/**", "/inverse", True),
        ("/**", "/a/b/inverse", True),
        ("/*", "/inverse", True),
        ("/*", "/a/inverse", False),
        ("/*/inverse", "/a/inverse", True),
        ("/**/inverse", "/inverse", True),
        ("/**/inverse", "/a/b/inverse", True),
        ("/a/**", "/a/b/inverse", True),
        ("/a/**", "/b/inverse", False),
        ("inverse", "/inverse", True),
        ("inverse", "/a/inverse", False),
        ("/a/inverse", "/a/inverse", True),
        ("/in.erse", "/inverse", False),
    ],
)
def test_patterns_of_node_names(pattern, node, fits):
    assert matches(pattern, node) is fits


FILE = """
/**:
  ros__parameters:
    rate: 50.0
    use_sim_time: true
/cell2:
  inverse:
    ros__parameters:
      rate: 20
      gains: {p: 1e-3, d: [0.1, 1]}
/cell2/forward:
  ros__parameters: {rate: 5}
forward:
  ros__parameters:
"""


def test_a_file_of_parameters(tmp_path):
    file = tmp_path / "arm.yaml"
    file.write_text(FILE)
    assert read_parameters(file, "/cell2/inverse") == {
        "rate": 20,
        "use_sim_time": True,
        "gains.p": 1e-3,
        "gains.d": [0.1, 1.0],
    }
    assert read_parameters(file, "/forward") == {"rate": 50.0, "use_sim_time": True}
    found = read(f"--ros-args -r __ns:=/cell2 -p rate:=1 --params-file {file} -p use_sim_time:=false")
    assert (found.parameters["rate"], found.parameters["use_sim_time"]) == (20, False)
    (tmp_path / "empty.yaml").write_text("# nothing\n")
    assert read_parameters(tmp_path / "empty.yaml", "/inverse") == {}


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[1, 2]", "expected names of nodes"),
        ("inverse: 3", "expected 'ros__parameters' under the name of a node"),
        ("inverse: {rate: 3}", "/inverse/rate: expected 'ros__parameters'"),
        ("ros__parameters: {rate: 3}", "must stand under the name of a node"),
        ("inverse: {ros__parameters: [1]}", "must hold names and values, got [1]"),
        ("inverse: {ros__parameters: {rate: null}}", "parameter 'rate' must be"),
        ("inverse: {ros__parameters: {a: {b: [1, x]}}}", "parameter 'a.b' must be a list of values of one type"),
        ("a: [", "is not YAML"),
    ],
)
def test_what_is_not_a_file_of_parameters(tmp_path, text, reason):
    file = tmp_path / "arm.yaml"
    file.write_text(text)
    with pytest.raises(RosError, match=re.escape(reason)) as caught:
        read_parameters(file, "/inverse")
    assert str(file) in str(caught.value)
