"""Several nodes started together, one process each, as ``ros2 launch`` does it.

The output of a process is shown line by line with its name before it. When one process ends, all end.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pieper.errors import unknown_name
from pieper.ros.nodes import NODES

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

PARENT = "PIEPER_LAUNCHED_BY"
"""Environment variable with the process id of a launch: its nodes end when it is gone, however it went."""

_LOOK = 0.05  # seconds between looks at the processes
_PATIENCE = 5.0  # seconds until a process that was asked to end is ended


@dataclass(frozen=True)
class Mode:
    """A set of nodes that belong together.

    Attributes
    ----------
    summary : str
        What they do, on one line.
    nodes : tuple of str
        In the order in which they are started.
    hints : tuple of str
        What to do next: one sentence each, and the command without ROS and with it.
    """

    summary: str
    nodes: tuple[str, ...]
    hints: tuple[tuple[str, str, str], ...]


_ASKED = "/calculate_ik pieper_interfaces/srv/CalculateIK '{{poses: [{{position: {{x: 0.3, y: 0.3, z: 0.3}}}}]}}'"

MODES = {
    "forward": Mode(
        "Move the joints and read the pose.",
        ("description", "controller", "forward"),
        (
            (
                "move the joints",
                "pieper ros pub /set_joint_states '{{name: [{joint}], position: [0.5]}}' --once",
                "ros2 topic pub --once /set_joint_states sensor_msgs/msg/JointState '{{name: [{joint}], position: [0.5]}}'",
            ),
            ("read the pose", "pieper ros echo /pose", "ros2 topic echo /pose"),
        ),
    ),
    "inverse": Mode(
        "Give a target and see the arm go there.",
        ("description", "controller", "inverse"),
        (
            (
                "give a target",
                "pieper ros pub /target geometry_msgs/msg/Point '{{x: 0.3, y: 0.3, z: 0.3}}' --once",
                "ros2 topic pub --once /target geometry_msgs/msg/Point '{{x: 0.3, y: 0.3, z: 0.3}}'",
            ),
            ("see the joints", "pieper ros echo /joint_states", "ros2 topic echo /joint_states"),
        ),
    ),
    "ik": Mode(
        "Inverse kinematics as services.",
        ("description", "ik_server"),
        (
            (
                "ask for joint values",
                f"pieper ros call {_ASKED}",
                f"ros2 service call {_ASKED}",
            ),
        ),
    ),
}


def find(mode: str) -> Mode:
    """Return the mode of that name.

    Raises
    ------
    UnknownNameError
        There is no such mode.
    """
    try:
        return MODES[mode]
    except KeyError:
        raise unknown_name("mode", mode, MODES) from None


def commands(mode: str, arm: str, *, ends: Sequence[str] = (), options: Sequence[str] = ()) -> dict[str, list[str]]:
    """Return the command line of each process of a mode, by its name.

    Parameters
    ----------
    mode : str
        One of `MODES`.
    arm : str
        As on the command line: a built-in robot or a file.
    ends : sequence of str
        Where the arm begins and ends, ``--tip LINK``: for every node but the description, which is of the whole robot.
    options : sequence of str
        For every node, ROS arguments last.

    Returns
    -------
    dict of str to list of str

    Examples
    --------
    >>> for name, command in commands("ik", "ur5e").items():
    ...     print(name, *command[1:])
    description -m pieper ros description ur5e
    ik_server -m pieper ros ik_server ur5e
    """
    pieper_ros = [sys.executable, "-m", "pieper", "ros"]
    return {
        node: [*pieper_ros, node, arm, *([] if NODES[node].needs == "robot" else ends), *options]
        for node in find(mode).nodes
    }


class Launch:
    """Processes that live and end together.

    Parameters
    ----------
    commands : dict
        Command line of each process, by its name.
    say : callable
        ``say(line)`` shows a line; called from several threads, one at a time.

    Attributes
    ----------
    code : int
        Exit code of the first process that failed by itself, 0 if none did; that of a signal is 128 and its number.
    """

    def __init__(self, commands: dict[str, list[str]], say: Callable[[str], None]) -> None:
        self.code = 0
        self._commands, self._show = commands, say
        self._lock = threading.Lock()
        self._processes: dict[str, subprocess.Popen[str]] = {}
        self._readers: list[threading.Thread] = []
        self._stopping = threading.Event()

    def stop(self) -> None:
        """Let :meth:`run` end; safe from a signal handler, and again and again."""
        self._stopping.set()

    def run(self, *, started: Callable[[], None] | None = None) -> int:
        """Start the processes, wait until one ends or :meth:`stop` is called, end the others, and return the exit code.

        Parameters
        ----------
        started : callable, optional
            Called when all have been started.

        Returns
        -------
        int
            0, or what the first process that failed by itself ended with.
        """
        try:
            for number, (name, command) in enumerate(self._commands.items(), 1):
                if not self._stopping.is_set():
                    self._start(f"{name}-{number}", command)
            if started is not None and not self._stopping.is_set():
                started()
            while not self._stopping.is_set() and all(p.poll() is None for p in self._processes.values()):
                self._stopping.wait(_LOOK)
            self._look_at_the_ended()
        finally:
            self._end_all()
        return self.code

    def _start(self, name: str, command: list[str]) -> None:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            encoding="utf-8",
            errors="replace",
            bufsize=1,
            env={**os.environ, "PYTHONUNBUFFERED": "1", "PYTHONIOENCODING": "utf-8", PARENT: str(os.getpid())},
            start_new_session=True,  # Ctrl-C comes from here alone, and once
        )
        self._processes[name] = process
        self.say(f"[INFO] [{name}]: process started with pid [{process.pid}]")
        reader = threading.Thread(target=self._read, args=(name, process), daemon=True)
        reader.start()
        self._readers.append(reader)

    def _read(self, name: str, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        with process.stdout as lines, suppress(ValueError):  # closed meanwhile
            for line in lines:
                self.say(f"[{name}] {line.rstrip()}")

    def _look_at_the_ended(self) -> None:
        for name, process in self._processes.items():
            code = process.poll()
            if code is None:
                continue
            if code == 0:
                self.say(f"[INFO] [{name}]: process has finished cleanly [pid {process.pid}]")
                continue
            self.say(f"[ERROR] [{name}]: process has died [pid {process.pid}, exit code {code}]")
            self.code = self.code or (code if code > 0 else 128 - code)

    def _end_all(self) -> None:
        running = {name: process for name, process in self._processes.items() if process.poll() is None}
        for process in running.values():
            process.terminate()
        deadline = time.monotonic() + _PATIENCE
        for name, process in running.items():
            try:
                code = process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                code = process.wait()
                self.say(f"[ERROR] [{name}]: did not end within {_PATIENCE:g} s and was killed [pid {process.pid}]")
            else:
                if code > 0:  # it had failed by itself before it was asked
                    self.say(f"[ERROR] [{name}]: process has died [pid {process.pid}, exit code {code}]")
                else:
                    self.say(f"[INFO] [{name}]: process has finished cleanly [pid {process.pid}]")
            if code > 0:
                self.code = self.code or code
        for reader in self._readers:
            reader.join(1.0)

    def say(self, line: str) -> None:
        """Show a line. One that cannot be shown must not end the reader: a process whose output nobody takes would hang."""
        try:
            with self._lock:
                self._show(line)
        except BrokenPipeError:  # whoever read this has seen enough, as `| head` does
            self.stop()
        except OSError:  # a full disk, say: no reason to stop an arm
            pass
