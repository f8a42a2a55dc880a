"""What a backend without rclpy has to bring: endpoints that move CDR bytes.

A :class:`pieper.ros.bus.Bus` is made on these. Names are fully resolved here
(``"/cell2/joint_states"``), types are ROS names, and bytes are CDR with their encapsulation. Everything is delivered from
within :meth:`Wire.wait`, in the thread that spins.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable

    from pieper.ros.qos import QoS
LEFT = "the node has left the network: its bus is closed; open another one"
"""What is said to those who go on with a node that is closed."""


class Endpoint(Protocol):
    """Something on the network that can be taken away again."""

    def close(self) -> None:
        """Leave the network."""


class Writer(Endpoint, Protocol):
    """The sending side of a topic."""

    def write(self, data: bytes) -> None:
        """Send one sample."""

    @property
    def matched(self) -> int:
        """Number of readers that are matched now."""


class Reader(Endpoint, Protocol):
    """The listening side of a topic."""

    @property
    def matched(self) -> int:
        """Number of writers that are matched now."""


class Caller(Endpoint, Protocol):
    """The asking side of a service."""

    def send(self, request: bytes, deliver: Callable[[bytes], None]) -> None:
        """Send a request; ``deliver(response)`` is called at most once, when its answer is here."""

    @property
    def ready(self) -> bool:
        """Whether a server is matched in both directions."""


class Wire(Protocol):
    """A node's connection to a network."""

    def open_writer(self, topic: str, type_name: str, qos: QoS) -> Writer:
        """Start sending on a topic."""

    def open_reader(self, topic: str, type_name: str, qos: QoS, deliver: Callable[[bytes], None]) -> Reader:
        """Start listening to a topic."""

    def open_server(
        self, service: str, type_name: str, answer: Callable[[bytes, Callable[[bytes], None]], None]
    ) -> Endpoint:
        """Start answering a service: ``answer(request, respond)`` calls ``respond(response)`` once, at once or later.

        Later means: from the thread that spins, after other requests have come, been answered, or not at all. A response
        that comes when the server or its caller has left is dropped without an error.
        """

    def open_caller(self, service: str, type_name: str) -> Caller:
        """Start asking a service."""

    def wait(self, timeout: float) -> None:
        """Deliver what is there; if nothing is, wait for something, at most ``timeout`` seconds, and deliver that."""

    def wake(self) -> None:
        """End a :meth:`wait` early; safe from any thread and from a signal handler."""

    def check(self) -> str | None:
        """Look after the connection: called about twice a second; a sentence if something had to be repaired."""

    def close(self) -> None:
        """Leave the network with all endpoints."""
