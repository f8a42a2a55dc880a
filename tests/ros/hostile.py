"""A node in a process of its own that is attacked over the loopback interface, and one that talks to it all the while."""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
HEARD = ("reliable", "sensor", "neighbour")
"""What is counted: good messages on the reliable topic, on the best-effort one, and on that one by the neighbour."""

PERIOD = 0.02
"""Seconds between two messages of the talker."""


def namespace(attacker: int) -> list[str]:
    """Arguments for the nodes of one attacker, so that two attackers on a machine do not mistake each other's nodes."""
    return ["--ros-args", "-r", f"__ns:=/attack{attacker}"]


def victim(domain: int, attacker: int) -> None:
    """Run the node, and a neighbour in the same process; it prints a line of JSON ten times a second, until its input ends."""
    from pieper.ros import open_bus
    from pieper.ros.bare import loopback
    from pieper.ros.qos import SENSOR

    bus = open_bus("victim", arguments=namespace(attacker), backend="bare", domain=domain)
    neighbour = open_bus("neighbour", arguments=namespace(attacker), backend="bare", domain=domain)
    heard = dict.fromkeys(HEARD, 0)

    def hear(name: str, message: object) -> None:
        if getattr(message, "data", "").startswith("good"):
            heard[name] += 1

    subscriptions = [
        bus.subscribe("reliable", "std_msgs/msg/String", lambda m: hear("reliable", m)),
        bus.subscribe("sensor", "std_msgs/msg/String", lambda m: hear("sensor", m), qos=SENSOR),
        bus.subscribe("joints", "sensor_msgs/msg/JointState", lambda m: None),
        bus.subscribe("image", "sensor_msgs/msg/Image", lambda m: None),
    ]
    neighbour.subscribe("sensor", "std_msgs/msg/String", lambda m: hear("neighbour", m), qos=SENSOR)
    said: list[str] = []
    plain = bus._print
    bus._print = neighbour._print = lambda line: (said.append(line), plain(line))

    def report() -> None:
        state = {
            **heard,
            "publishers": subscriptions[0].publishers,
            "undecodable": sum(s.undecodable for s in subscriptions),
            "ports": [s.port for s in loopback.receivers(domain)],
            "reachable": [f"{s.address}:{s.port}" for s in loopback.sockets() if s.reachable],
            "prefix": bus._wire._participant.guid[:12].hex(),
            "said": [line for line in said if "deaf" in line],
        }
        try:
            print(json.dumps(state), flush=True)
        except BrokenPipeError:
            bus.stop()

    bus.timer(0.1, report)
    bus.timer(0.01, lambda: neighbour.spin_once(0.0))
    threading.Thread(target=lambda: (sys.stdin.read(), bus.stop()), daemon=True).start()
    bus.spin()
    neighbour.close()
    bus.close()


class Victim:
    """The process of the node, as its attacker sees it; nobody reads its standard error unless asked to."""

    def __init__(self, domain: int) -> None:
        self.domain = domain
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.ros.hostile", str(domain), str(os.getpid())],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT / "src"), str(ROOT)])},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.state: dict = {}
        self.lines = 0
        self._reading = threading.Thread(target=self._read, daemon=True)
        self._reading.start()

    def _read(self) -> None:
        for line in self.process.stdout:
            self.state = json.loads(line)
            self.lines += 1

    @property
    def alive(self) -> bool:
        return self.process.poll() is None

    @property
    def memory(self) -> float:
        """Resident memory [MiB]."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.search(r"VmRSS:\s+(\d+)", status)[1]) / 1024

    @property
    def deaf(self) -> list[str]:
        """The lines in which it said that it had gone deaf."""
        return self.state.get("said", [])

    def send(self, datagram: bytes) -> None:
        """Send a datagram to both of its ports."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as attacker:
            for port in self.state["ports"]:
                attacker.sendto(datagram, ("127.0.0.1", port))

    def close(self) -> int:
        """End it; its exit code."""
        self.process.stdin.close()
        try:
            self.process.wait(5.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._reading.join(5.0)
        self.process.stdout.close()
        self.process.stderr.close()
        return self.process.returncode


class Talker:
    """A node in this process that sends good messages on two topics all the time."""

    def __init__(self, domain: int) -> None:
        from pieper.ros import open_bus
        from pieper.ros.qos import SENSOR

        self.bus = open_bus("talker", arguments=namespace(os.getpid()), backend="bare", domain=domain)
        self.reliable = self.bus.publisher("reliable", "std_msgs/msg/String")
        self.sensor = self.bus.publisher("sensor", "std_msgs/msg/String", qos=SENSOR)
        self.joints = self.bus.publisher("joints", "sensor_msgs/msg/JointState")
        self.image = self.bus.publisher("image", "sensor_msgs/msg/Image")
        self.sent = 0
        self._timer = self.bus.timer(PERIOD, self._talk)

    def _talk(self) -> None:
        self.sent += 1
        self.reliable.send(data=f"good {self.sent}")
        self.sensor.send(data=f"good {self.sent}")

    def guid(self, publisher) -> bytes:
        """The 16 bytes that DDS calls a publisher."""
        return publisher._writer.writer_guids[0]

    def until(self, condition, seconds: float) -> float | None:
        """Talk until the condition holds; the seconds that took, or None."""
        start = time.monotonic()
        while not condition():
            if time.monotonic() - start > seconds:
                return None
            self.bus.spin_once(0.01)
        return time.monotonic() - start

    def hearing(self, victim: Victim, seconds: float = 15.0) -> float | None:
        """Talk until the victim has heard five more messages on each topic; the seconds that took, or None."""
        self.until(lambda: False, 0.2)  # what was on its way before
        before = dict(victim.state)
        took = self.until(lambda: all(victim.state.get(t, 0) >= before.get(t, 0) + 5 for t in HEARD), seconds)
        self.unheard = [t for t in HEARD if victim.state.get(t, 0) < before.get(t, 0) + 5]
        return took

    def close(self) -> None:
        self.bus.close()


if __name__ == "__main__":
    victim(int(sys.argv[1]), int(sys.argv[2]))
