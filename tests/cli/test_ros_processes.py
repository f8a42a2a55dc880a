"""Nodes as one starts them: processes of their own, on a real network that ends at this machine."""

from __future__ import annotations

import os
import queue
import signal
import subprocess
import sys
import threading
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import pieper
from pieper.ros import open_bus
from tests.ros.domains import new_domain

pytestmark = pytest.mark.skipif(find_spec("cyclonedds") is None, reason="cyclonedds is not installed")

LONG = 60.0  # seconds: whoever waits so long has failed; nothing is measured
DOCUMENTS_ACCURACY = 1e-4  # m, what the source reports claim for their inverse node
OUR_ACCURACY = 1e-9  # m


class Process:
    """A command with its lines as they come."""

    def __init__(self, *arguments, domain):
        self.process = subprocess.Popen(
            [sys.executable, "-m", "pieper", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, "ROS_DOMAIN_ID": str(domain), "PYTHONUNBUFFERED": "1", "PIEPER_ROS_BACKEND": "bare"},
        )
        self.lines = []
        self._queue = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        with self.process.stdout as lines:
            for line in lines:
                self._queue.put(line.rstrip())
        self._queue.put(None)

    def wait_for(self, text):
        while not any(text in line for line in self.lines):
            line = self._queue.get(timeout=LONG)
            assert line is not None, f"ended before it said {text!r}: {self.lines}"
            self.lines.append(line)

    def end(self, number=signal.SIGINT):
        self.process.send_signal(number)
        return self.ended()

    def ended(self):
        code = self.process.wait(LONG)
        while (line := self._queue.get(timeout=LONG)) is not None:
            self.lines.append(line)
        return code

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait(LONG)


@pytest.fixture(autouse=True)
def hangups_are_heard():
    """As in a terminal; where the tests were started by nohup, the processes would inherit that they are not."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.fixture
def domain():
    return new_domain()


def wait_until_gone(pid):
    """Wait for a process that is no child of this one."""
    for _ in range(int(LONG / 0.1)):
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return
        if Path(f"/proc/{pid}/stat").exists() and Path(f"/proc/{pid}/stat").read_text().split(") ")[1][0] == "Z":
            return  # it has ended, and nobody asked how
        time.sleep(0.1)
    raise AssertionError(f"process {pid} is still there")


def test_a_target_from_a_third_process_moves_the_arm(domain):
    """Two nodes and `pieper ros pub`, each a process: the arm ends where the target is."""
    arm = pieper.load("mh12")
    last = {}

    def hear(message):
        last["q"] = np.array([dict(zip(message.name, message.position, strict=True))[name] for name in arm.joint_names])
        last["speed"] = float(np.abs(message.velocity).max()) if len(message.velocity) else np.inf

    def distance():
        return np.linalg.norm(arm.fk(last["q"])[:3, 3] - 0.3) if last else np.inf

    with (
        Process("ros", "controller", "mh12", domain=domain) as controller,
        Process("ros", "inverse", "mh12", domain=domain) as inverse,
        open_bus("listener", backend="bare", domain=domain) as bus,
    ):
        bus.subscribe("joint_states", "sensor_msgs/msg/JointState", hear)
        controller.wait_for("Ready to move")
        inverse.wait_for("Node inverse started")
        assert bus.spin_until(lambda: bool(last), timeout=LONG)
        assert distance() > 0.1
        target = ("ros", "pub", "/target", "geometry_msgs/msg/Point", "{x: 0.3, y: 0.3, z: 0.3}", "--once")
        with Process(*target, domain=domain) as third:
            assert bus.spin_until(lambda: distance() < DOCUMENTS_ACCURACY and last["speed"] == 0.0, timeout=LONG)
            assert third.ended() == 0
        assert distance() < OUR_ACCURACY
        for node in (controller, inverse):
            assert node.end(signal.SIGINT) == 0
            assert not any("Traceback" in line for line in node.lines)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_a_node_with_code_0(domain, number):
    with Process("ros", "rotations", domain=domain) as node:
        node.wait_for("Ready to convert quaternions")
        said = list(node.lines)
        assert node.end(number) == 0
    assert node.lines == said, "a node ends without a word"


def test_a_signal_ends_a_node_that_waits_for_a_description_with_code_0(domain):
    with Process("ros", "forward", "topic:/robot_description", domain=domain) as node:
        node.wait_for("Waiting for a robot description on /robot_description")
        said = list(node.lines)
        assert node.end() == 0
    assert node.lines == said


def test_a_signal_twice_is_a_signal_once(domain):
    with Process("ros", "rotations", domain=domain) as node:
        node.wait_for("Ready to convert quaternions")
        node.process.send_signal(signal.SIGINT)
        node.process.send_signal(signal.SIGTERM)
        assert node.ended() == 0


def test_a_launch_starts_all_and_a_signal_ends_all(domain):
    with Process("launch", "ik", "--arm", "ur5e", domain=domain) as launch:
        launch.wait_for("[ik_server-2] ")
        launch.wait_for("Ready to receive an IK request")
        launch.wait_for("[description-1] ")
        assert launch.end(signal.SIGINT) == 0
    assert any("[description-1]: process has finished cleanly" in line for line in launch.lines)
    assert any("[ik_server-2]: process has finished cleanly" in line for line in launch.lines)
    assert any("pieper ros call /calculate_ik" in line for line in launch.lines)


def test_a_launch_ends_when_one_node_cannot_start(domain):
    with Process("launch", "inverse", "--arm", "mh12", "method:=guess", domain=domain) as launch:
        assert launch.ended() == 2
    assert any("[inverse-3] pieper: parameter 'method'" in line for line in launch.lines)
    assert any("[ERROR] [inverse-3]: process has died" in line for line in launch.lines)


def test_the_nodes_of_a_launch_that_was_killed_end(domain):
    with Process("launch", "ik", "--arm", "ur5e", domain=domain) as launch:
        launch.wait_for("Ready to receive an IK request")
        assert launch.end(signal.SIGKILL) == -signal.SIGKILL
        started = [line for line in launch.lines if "process started with pid" in line]
        pids = [int(line.rpartition("[")[2].rstrip("]")) for line in started]
    assert len(pids) == 2
    for pid in pids:
        wait_until_gone(pid)


def test_a_closing_terminal_does_not_end_what_nohup_started(domain):
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does, for the processes that are started
    try:
        with Process("launch", "ik", "--arm", "ur5e", domain=domain) as launch:
            launch.wait_for("Ready to receive an IK request")
            launch.process.send_signal(signal.SIGHUP)
            with Process("ros", "call", "/calculate_ik", "pieper_interfaces/srv/CalculateIK", domain=domain) as user:
                assert user.ended() == 0
            assert launch.end(signal.SIGINT) == 0
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_a_node_outlives_a_log_that_cannot_be_written(domain):
    """A full disk under its log, or a pipe that nobody reads any more."""
    arguments = [sys.executable, "-m", "pieper", "ros", "rotations", "--domain", str(domain), "--backend", "bare"]
    with Path("/dev/full").open("w") as full, subprocess.Popen(arguments, stderr=full) as node:
        try:
            wrong = ("ros", "call", "/quat2zyx", "pieper_interfaces/srv/QuatToZYX", "{q: {w: 0.0}}")
            with Process(*wrong, domain=domain) as user:
                user.wait_for("data: .nan")
                assert user.ended() == 0
            node.send_signal(signal.SIGINT)
            assert node.wait(LONG) == 0
        finally:
            node.kill()
