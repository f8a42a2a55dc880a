"""Networks on which the contract of the bus is tested: every backend that this machine has."""

from __future__ import annotations

import time
from contextlib import ExitStack
from importlib.util import find_spec

import pytest

from pieper.ros import Bus, open_bus
from pieper.ros.fake import FakeNetwork
from tests.ros import stub_rclpy
from tests.ros.domains import new_domain


def backends():
    """Fake and bare; and rclpy where ROS 2 is installed, otherwise its wire on a stand-in."""
    yield "fake"
    yield pytest.param(
        "bare", marks=pytest.mark.skipif(find_spec("cyclonedds") is None, reason="cyclonedds is not installed")
    )
    yield "rclpy" if find_spec("rclpy") else "rclpy stub"


class Network:
    """Some nodes on one network, all in this process, and a way to let them work."""

    def __init__(self, backend: str) -> None:
        self.backend = backend
        self.buses: list[Bus] = []
        self._fake = FakeNetwork()
        self.domain = new_domain()
        self._stack = ExitStack()
        if backend == "rclpy stub":
            self._stack.enter_context(stub_rclpy.installed())

    def join(self, node: str, *arguments: str) -> Bus:
        if self.backend == "fake":
            bus: Bus = self._fake.bus(node, arguments)
        else:
            bus = open_bus(node, arguments=arguments, backend=self.backend.split()[0], domain=self.domain)
        self._stack.callback(bus.close)
        self.buses.append(bus)
        return bus

    def until(self, condition, seconds: float = 5.0) -> bool:
        """Let all nodes work until the condition holds."""
        if self.backend == "fake":
            for _ in range(round(seconds * 1000)):
                self._fake.settle()
                if condition():
                    return True
                self._fake.advance(0.001)
            return bool(condition())
        deadline = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > deadline:
                return False
            for bus in self.buses:
                if bus.ok:
                    bus.spin_once(0.001 / len(self.buses))
        return True

    def rest(self, seconds: float = 0.3) -> None:
        """Let all nodes work for a while, so that what should not come has had its time to come."""
        self.until(lambda: False, seconds)

    def close(self) -> None:
        self._stack.close()
