"""The one small interface between a node and its network: topics, services, parameters, timers, clock, log.

A node is written against :class:`Bus` and knows no backend. Three backends implement it: ``rclpy`` where ROS 2 is
installed, ``bare`` (DDS by itself) where it is not, and ``fake`` inside one process for tests. All callbacks run in
the thread that spins the bus, one at a time, so a node needs no locks.

Types are named as ROS names them, ``"sensor_msgs/msg/JointState"``. What is sent is given by its fields; what arrives
is an object with those fields as attributes. Numeric sequences may arrive as NumPy arrays or as ``array.array``: take
``numpy.asarray(message.position)``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from types import TracebackType

    from typing_extensions import Self

Value = TypeVar("Value", bound="bool | int | float | str | list[bool] | list[int] | list[float] | list[str]")


@dataclass(frozen=True)
class QoS:
    """Quality of service of a topic; publisher and subscriber have to be compatible, as in ROS 2.

    Attributes
    ----------
    reliable : bool
        Lost samples are sent again. A reliable subscriber does not hear a best-effort publisher.
    transient_local : bool
        Late subscribers still get the last ``depth`` samples ("latched").
    depth : int
        How many samples are kept on either side: the bound of every queue.
    lifespan : float
        Seconds after which a sample is thrown away; infinite by default.
    """

    reliable: bool = True
    transient_local: bool = False
    depth: int = 10
    lifespan: float = float("inf")


DEFAULT = QoS()
SENSOR = QoS(reliable=False, depth=5)
LATCHED = QoS(transient_local=True, depth=1)
TF = QoS(depth=100)
ROSOUT = QoS(transient_local=True, depth=1000, lifespan=10.0)
CLOCK = QoS(reliable=False, depth=1)
SERVICES = QoS(depth=10)
PARAMETER_EVENTS = QoS(depth=1000)


class Publisher(ABC):
    """One side of a topic that sends."""

    topic: str
    type: str

    @abstractmethod
    def send(self, message: Mapping[str, Any] | object | None = None, /, **fields: Any) -> None:
        """Send a message made from its fields; those that are not given take their defaults.

        Parameters
        ----------
        message : mapping or message, optional
            All fields at once: nested mappings, or a message as it was received.
        **fields
            Fields by name; a nested message is a mapping or a message.

        Raises
        ------
        RosError
            A field is unknown to the type, or a value does not fit its field. Nothing is sent then.
        """

    @property
    @abstractmethod
    def subscribers(self) -> int:
        """Number of subscribers that are matched now."""

    @abstractmethod
    def close(self) -> None:
        """Leave the topic."""


class Subscription(ABC):
    """One side of a topic that listens."""

    topic: str
    type: str

    @property
    @abstractmethod
    def publishers(self) -> int:
        """Number of publishers that are matched now."""

    @property
    @abstractmethod
    def undecodable(self) -> int:
        """Number of samples that were dropped because their bytes did not fit the type."""

    @abstractmethod
    def close(self) -> None:
        """Leave the topic."""


class Service(ABC):
    """A service that this node answers."""

    name: str
    type: str

    @abstractmethod
    def close(self) -> None:
        """Stop answering."""


class Client(ABC):
    """A service that another node answers."""

    name: str
    type: str

    @property
    @abstractmethod
    def ready(self) -> bool:
        """Whether a server is there now."""

    @abstractmethod
    def send(
        self, on_reply: Callable[[Any], None], message: Mapping[str, Any] | object | None = None, /, **fields: Any
    ) -> None:
        """Send a request; ``on_reply(response)`` is called from the spin when the answer arrives.

        Raises
        ------
        RosError
            A field is unknown to the request, or a value does not fit.
        """

    @abstractmethod
    def close(self) -> None:
        """Forget the service; answers that are still to come are dropped."""


class Timer(ABC):
    """Something that happens again and again, on the clock of the bus."""

    period: float

    @abstractmethod
    def cancel(self) -> None:
        """No more calls."""


class Parameter(ABC, Generic[Value]):
    """A declared parameter; others may set it while the node runs, so read :attr:`value` when it is needed."""

    name: str
    description: str

    @property
    @abstractmethod
    def value(self) -> Value:
        """The value now."""


class Bus(ABC):
    """A node on a network.

    Use it as a context manager, or :meth:`close` it.

    Attributes
    ----------
    backend : str
        ``"rclpy"``, ``"bare"`` or ``"fake"``.
    node : str
        Name of the node, without its namespace.
    namespace : str
        ``"/"`` or ``"/cell2"``.
    """

    backend: str
    node: str
    namespace: str

    # Topics

    @abstractmethod
    def publisher(self, topic: str, type_name: str, *, qos: QoS = DEFAULT) -> Publisher:
        """Make a publisher.

        Parameters
        ----------
        topic : str
            Relative (``"target"``), private (``"~/state"``) or absolute (``"/tf"``); remapping applies.
        type_name : str
            For example ``"geometry_msgs/msg/Point"``.
        qos : QoS
            Quality of service.

        Raises
        ------
        RosError
            The name is not a valid topic name, or the type is not known.
        """

    @abstractmethod
    def subscribe(
        self, topic: str, type_name: str, callback: Callable[[Any], None], *, qos: QoS = DEFAULT
    ) -> Subscription:
        """Call ``callback(message)`` for every message of a topic; parameters as for :meth:`publisher`."""

    # Services

    @abstractmethod
    def serve(self, name: str, type_name: str, callback: Callable[[Any], Mapping[str, Any] | object]) -> Service:
        """Answer a service: ``callback(request)`` returns the fields of the response.

        A callback that raises gets the caller a response with every field at its default, and the error goes to the
        log: a server must not leave a caller waiting for ever.
        """

    @abstractmethod
    def client(self, name: str, type_name: str) -> Client:
        """Make a client of a service."""

    def call(
        self, client: Client, timeout: float, message: Mapping[str, Any] | object | None = None, /, **fields: Any
    ) -> Any:
        """Wait for the server, send the request, spin until the answer is here, and return it.

        Not from inside a callback: there, use :meth:`Client.send`.

        Parameters
        ----------
        client : Client
            From :meth:`client`.
        timeout : float
            Seconds, for the server to appear and to answer.

        Raises
        ------
        TimeoutError
            No server, or no answer in time; the message says which.
        """
        import time

        deadline = time.monotonic() + timeout
        if not self.spin_until(lambda: client.ready, timeout=timeout):
            raise TimeoutError(f"no server for {client.name} ({client.type}) within {timeout:g} s")
        answers: list[Any] = []
        client.send(answers.append, message, **fields)
        if not self.spin_until(lambda: bool(answers), timeout=max(0.0, deadline - time.monotonic())):
            raise TimeoutError(f"no answer from {client.name} ({client.type}) within {timeout:g} s")
        return answers[0]

    # Time

    @abstractmethod
    def timer(self, period: float, callback: Callable[[], None]) -> Timer:
        """Call ``callback()`` every ``period`` seconds of the bus's clock, first after one period.

        A timer that has fallen behind is called once and goes on from there; missed calls are not made up for.
        """

    @abstractmethod
    def now(self) -> int:
        """Nanoseconds since 1970 by the clock of the bus: the system's, or ``/clock`` with ``use_sim_time``."""

    def stamp(self) -> dict[str, int]:
        """Return :meth:`now` as the fields of ``builtin_interfaces/msg/Time``."""
        seconds, nanoseconds = divmod(self.now(), 1_000_000_000)
        return {"sec": seconds, "nanosec": nanoseconds}

    # Parameters and log

    @abstractmethod
    def parameter(
        self,
        name: str,
        default: Value,
        *,
        description: str = "",
        check: Callable[[Value], None] | None = None,
        read_only: bool = False,
    ) -> Parameter[Value]:
        """Declare a parameter; its type is that of the default.

        Parameters
        ----------
        name : str
            For example ``"rate"``.
        default : bool, int, float, str, or a list of one of them
            Value unless the command line, a file of parameters or another node says otherwise.
        description : str
            One line for ``ros2 param describe``.
        check : callable, optional
            ``check(value)`` raises ``ValueError(reason)`` for a value that is refused.
        read_only : bool
            Settable at the start only.

        Raises
        ------
        RosError
            The value given at the start has another type or is refused; the name is declared twice.
        """

    @abstractmethod
    def log(self, level: str, text: str) -> None:
        """Write a line to standard error and to ``/rosout``; ``level`` is debug, info, warn, error or fatal."""

    # Life

    @abstractmethod
    def spin_once(self, timeout: float | None = None) -> None:
        """Wait for something to do, at most ``timeout`` seconds (for ever if None), and do all of it."""

    @property
    @abstractmethod
    def ok(self) -> bool:
        """False after :meth:`close`, :meth:`stop` or a signal to stop."""

    @abstractmethod
    def stop(self) -> None:
        """Make :meth:`spin` return soon; safe from any thread and from a signal handler."""

    @abstractmethod
    def close(self) -> None:
        """Leave the network. Closing twice does no harm."""

    def spin(self) -> None:
        """Handle whatever comes until :meth:`stop`."""
        while self.ok:
            self.spin_once(None)

    def spin_until(self, condition: Callable[[], bool], *, timeout: float | None = None) -> bool:
        """Spin until ``condition()`` holds; False if it did not within ``timeout`` seconds or the bus was stopped."""
        import time

        deadline = float("inf") if timeout is None else time.monotonic() + timeout
        while self.ok and not condition():
            remaining = deadline - time.monotonic()
            if remaining <= 0.0:
                break
            self.spin_once(min(remaining, 0.05))
        return condition()

    def __enter__(self) -> Self:
        """Return the bus itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave the network."""
        self.close()
