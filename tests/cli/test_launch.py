"""Processes that live and end together."""

from __future__ import annotations

import sys
import threading

import pytest

from pieper.cli import main as command
from pieper.errors import UnknownNameError
from pieper.ros import launch, nodes
from pieper.ros.launch import Launch, commands

PATIENT = "import time; print('ready'); time.sleep(60)"  # ended by the signal that a launch sends
DEAF = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('ready'); time.sleep(60)"


def python(code):
    return [sys.executable, "-u", "-c", code]


class Lines(list):
    """What a launch says; something may happen when a line has come a number of times."""

    def when(self, text, times, action):
        self.text, self.times, self.action = text, times, action
        return self

    def __call__(self, line):
        self.append(line)
        if sum(self.text in said for said in self) == self.times and self.text in line:
            self.action()


def run(processes, lines=None):
    lines = Lines().when("nothing", 1, print) if lines is None else lines
    started = Launch(processes, lines)
    return started.run(), lines


def test_every_mode_is_of_nodes_that_are_there():
    for mode in launch.MODES.values():
        assert set(mode.nodes) <= set(nodes.NODES)
    assert commands("forward", "mh12", options=["--domain", "3"])["forward"][1:] == [
        "-m", "pieper", "ros", "forward", "mh12", "--domain", "3",
    ]  # fmt: skip


def test_an_unknown_mode_is_said():
    with pytest.raises(UnknownNameError, match="no mode 'froward'; did you mean 'forward'"):
        commands("froward", "mh12")


def test_lines_come_with_the_name_of_their_process():
    code, lines = run({"one": python("import sys; print('out'); print('err', file=sys.stderr)")})
    assert code == 0
    assert lines[0].startswith("[INFO] [one-1]: process started with pid [")
    assert "[one-1] out" in lines
    assert "[one-1] err" in lines
    assert any("[INFO] [one-1]: process has finished cleanly" in line for line in lines)


def test_all_end_when_one_ends():
    code, lines = run({"patient": python(PATIENT), "brief": python("print('done')")})
    assert code == 0
    assert any("[brief-2]: process has finished cleanly" in line for line in lines)
    assert any("[patient-1]: process has finished cleanly" in line for line in lines)


def test_the_code_of_the_one_that_failed_is_the_code_of_all():
    code, lines = run({"patient": python(PATIENT), "broken": python("raise SystemExit(3)")})
    assert code == 3
    assert any("[ERROR] [broken-2]: process has died" in line and "exit code 3" in line for line in lines)


def test_stop_ends_all_with_code_0():
    lines = Lines().when("] ready", 2, lambda: started.stop())
    started = Launch({"one": python(PATIENT), "two": python(PATIENT)}, lines)
    assert started.run() == 0
    assert sum("process has finished cleanly" in line for line in lines) == 2


def test_what_does_not_end_is_killed(monkeypatch):
    monkeypatch.setattr(launch, "_PATIENCE", 0.3)
    lines = Lines().when("] ready", 1, lambda: started.stop())
    started = Launch({"deaf": python(DEAF)}, lines)
    assert started.run() == 0
    assert any("did not end within 0.3 s and was killed" in line for line in lines)


def test_a_stop_before_the_start_starts_nothing():
    lines = Lines().when("nothing", 1, print)
    started = Launch({"one": python(PATIENT)}, lines)
    started.stop()
    assert (started.run(), lines) == (0, [])


def test_output_that_is_no_text_is_shown_somehow():
    _, lines = run({"odd": python(r"import sys; sys.stdout.buffer.write(b'\xff\xfe caf\xc3\xa9\n')")})
    assert any("café" in line for line in lines)


# The verb


@pytest.fixture
def launched(monkeypatch):
    """What would be started, and with which exit code it ends."""
    asked = []

    def run(self, *, started=None):
        asked.append(self._commands)
        self.say("[INFO] started")
        if started:
            started()
        return 0

    monkeypatch.setattr(Launch, "run", run)
    return asked


@pytest.mark.parametrize(
    "line",
    [
        "inverse --arm mh12",
        "inverse arm:=mh12",
        "mode:=inverse arm:=mh12",
        "mode:=inverse --arm mh12",
        "inverse --arm mh12 mode:=inverse",
    ],
)
def test_modes_and_arms_are_named_as_in_either_world(pieper_command, launched, line):
    result = pieper_command("launch", *line.split())
    assert result.code == 0
    (processes,) = launched
    assert list(processes) == ["description", "controller", "inverse"]
    assert all(c[3:] == ["ros", name, "mh12"] for name, c in processes.items())
    assert "pieper ros pub /target geometry_msgs/msg/Point '{x: 0.3, y: 0.3, z: 0.3}' --once" in result.out
    assert "ros2 topic pub --once /target geometry_msgs/msg/Point '{x: 0.3, y: 0.3, z: 0.3}'" in result.out


@pytest.mark.parametrize("line", ["forward --ur-type ur5e", "forward ur_type:=ur5e"])
def test_ur_types(pieper_command, launched, line):
    result = pieper_command("launch", *line.split())
    assert result.code == 0
    assert all(c[-1] == "ur5e" for c in launched[0].values())
    assert "{name: [shoulder_pan_joint], position: [0.5]}" in result.out


def test_the_code_of_a_node_is_the_code_of_the_command(pieper_command, monkeypatch):
    failing = {"one": python("raise SystemExit(3)"), "two": python(PATIENT)}
    monkeypatch.setattr(launch, "commands", lambda *_, **__: failing)
    result = pieper_command("launch", "inverse", "--arm", "mh12")
    assert result.code == 3
    assert "process has died" in result.out


def test_what_fails_while_it_is_asked_to_end_is_told():
    failing = "import signal, sys, time; signal.signal(signal.SIGTERM, lambda *_: sys.exit(3)); print('ready'); time.sleep(60)"
    lines = Lines().when("] ready", 1, lambda: started.stop())
    started = Launch({"one": python(failing)}, lines)
    assert started.run() == 3
    assert any("process has died" in line and "exit code 3" in line for line in lines)


def test_what_is_for_the_nodes_gets_there(pieper_command, launched):
    line = "launch inverse --arm mh12 method:=report --domain 3 --network --backend bare --ros-args -r __ns:=/cell2"
    assert pieper_command(*line.split()).code == 0
    expected = "--backend bare --network --domain 3 --ros-args -p method:=report -- --ros-args -r __ns:=/cell2"
    assert " ".join(launched[0]["inverse"][6:]) == expected


def test_the_ends_of_the_arm_are_for_all_that_have_an_arm(pieper_command, launched):
    assert pieper_command("launch", "forward", "--arm", "ur5e", "--tip", "flange").code == 0
    assert launched[0]["forward"][5:] == ["ur5e", "--tip", "flange"]
    assert launched[0]["controller"][5:] == ["ur5e", "--tip", "flange"]
    assert launched[0]["description"][5:] == ["ur5e"]


def test_what_is_next_is_said_with_the_namespace(pieper_command, launched):
    result = pieper_command("launch", "inverse", "--arm", "mh12", "--ros-args", "-r", "__ns:=/cell2")
    assert "pieper ros pub /cell2/target geometry_msgs/msg/Point '{x: 0.3" in result.out
    assert "ros2 topic echo /cell2/joint_states" in result.out


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("", "name the mode, as in: pieper launch forward --arm mh12"),
        ("inverse", "name the arm, as in: pieper launch inverse --arm mh12"),
        ("inverze --arm mh12", "no mode 'inverze'; did you mean 'inverse'"),
        ("inverse --arm mh13", "did you mean 'mh12'"),
        ("inverse --arm ur5e --tip tool1", "tool1"),
        ("inverse --arm ur5e --ros-args -r bad", "a remapping is written 'from:=to'"),
        ("inverse forward --arm mh12", "one mode, got 'inverse' and 'forward'"),
        ("inverse --arm mh12 --ur-type ur5e", "one arm, got 'mh12' and 'ur5e'"),
    ],
)
def test_bad_input_is_said_before_anything_is_started(pieper_command, launched, line, complaint):
    result = pieper_command("launch", *line.split())
    assert result.code == command.BAD_INPUT
    assert complaint in result.err
    assert not launched


def test_nothing_is_left_of_a_launch():
    before = threading.active_count()
    run({"one": python("print('done')")})
    assert threading.active_count() == before


def test_a_reader_that_leaves_ends_all_and_hangs_nothing():
    """As ``pieper launch ... | head``: the processes go on writing more than a pipe holds, and end when they are asked to."""
    talker = python("import time\nwhile True:\n    print('x' * 1000, flush=True); time.sleep(0.001)")
    said = []

    def show(line):
        if len(said) == 3:
            raise BrokenPipeError
        said.append(line)

    assert Launch({"one": talker, "two": python(PATIENT)}, show).run() == 0


def test_a_log_that_cannot_be_written_stops_no_arm():
    """A full disk: the lines are lost, and the processes go on until they end by themselves."""

    def show(_):
        raise OSError(28, "No space left on device")

    assert Launch({"one": python("import sys; print('x' * 200_000); sys.exit(3)")}, show).run() == 3
