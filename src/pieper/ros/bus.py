"""The one small interface between a node and its network: topics, services, parameters, timers, clock, log.

A node is written against :class:`Bus` and knows no backend. What moves the bytes is a :class:`~pieper.ros.wire.Wire`,
and there are three: ``rclpy`` where ROS 2 is installed, ``bare`` (DDS by itself) where it is not, and ``fake`` inside
one process for tests. All callbacks run in the thread that spins the bus, one at a time, so a node needs no locks.

Types are named as ROS names them, ``"sensor_msgs/msg/JointState"``. What is sent is given by its fields; what arrives
is an object with those fields as attributes, numeric sequences as NumPy arrays.

Examples
--------
>>> from pieper.ros.fake import FakeNetwork
>>> network = FakeNetwork()
>>> camera, arm = network.bus("camera"), network.bus("arm")
>>> heard = arm.subscribe("target", "geometry_msgs/msg/Point", lambda point: print(point.x))
>>> camera.publisher("target", "geometry_msgs/msg/Point").send(x=0.3)
>>> network.settle()
0.3
"""

from __future__ import annotations

import heapq
import itertools
import sys
import time
import traceback
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from pieper.errors import PieperError, RosError
from pieper.ros import messages
from pieper.ros.endpoints import Client, Publisher, Reply, Service, Subscription, Timer
from pieper.ros.names import resolve
from pieper.ros.parameters import Parameter, Parameters, as_value
from pieper.ros.qos import CLOCK, DEFAULT, PARAMETER_EVENTS, ROSOUT, QoS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from types import TracebackType

    from typing_extensions import Self

    from pieper.ros.arguments import Arguments
    from pieper.ros.wire import Wire

__all__ = ["Bus", "Client", "Publisher", "Service", "Subscription", "Timer"]

_LEVELS = {"debug": 10, "info": 20, "warn": 30, "error": 40, "fatal": 50}
_CHECK_EVERY = 0.5  # seconds between looks at the health of the wire
_CLOCK_EXPECTED = 3.0  # seconds without /clock after which that is said
_LONGEST_WAIT = 0.1  # seconds; a signal that arrives while waiting is seen within this time


class Bus:
    """A node on a network.

    Use it as a context manager, or :meth:`close` it. :func:`pieper.ros.open_bus` makes one.

    Parameters
    ----------
    wire : Wire
        The connection; the bus closes it.
    node : str
        Name of the node, unless the arguments rename it.
    arguments : Arguments
        What ``--ros-args`` said.
    backend : str
        ``"rclpy"``, ``"bare"`` or ``"fake"``.

    Attributes
    ----------
    backend, node, namespace : str
        As above; the namespace is ``"/"`` or such as ``"/cell2"``.
    errors : list of Exception
        The last hundred errors that callbacks raised; each went to the log, and the node went on.
    """

    def __init__(self, wire: Wire, *, node: str, arguments: Arguments, backend: str) -> None:
        self.backend = backend
        self.node = arguments.node or node
        self.namespace = arguments.namespace or "/"
        self.errors: list[Exception] = []
        self._wire = wire
        self._remaps = arguments.remaps
        self._threshold = _LEVELS[arguments.log_level or "info"]
        self._ok, self._closed = True, False
        self._timers: list[tuple[int, int, Timer]] = []
        self._tie_break = itertools.count()
        self._checked = time.monotonic()
        self._clock: Subscription | None = None
        self._clockless_since: float | None = None
        self._sim_time, self._last_time, self._last_simulated = 0, 0, False
        self._parameters = Parameters(arguments.parameters)
        self._use_sim_time: Parameter[bool] = self.parameter(
            "use_sim_time", False, description="take the time from /clock"
        )
        self._rosout = self.publisher("/rosout", "rcl_interfaces/msg/Log", qos=ROSOUT)
        self._parameter_events = self.publisher(
            "/parameter_events", "rcl_interfaces/msg/ParameterEvent", qos=PARAMETER_EVENTS
        )
        self._parameters.on_change = self._tell_parameters
        for service, type_name, answer in self._parameters.services():
            self.serve(service, type_name, answer)

    # Topics

    def resolve(self, name: str) -> str:
        """Return the full name of a topic or service, after remapping."""
        return resolve(name, namespace=self.namespace, node=self.node, remaps=self._remaps)

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

        Returns
        -------
        Publisher
            ``publisher.send(x=1.0)``, or a message.

        Raises
        ------
        RosError
            The name is not a valid topic name, or the type is not known.
        """
        name = self.resolve(topic)
        messages.fields_of(type_name)
        return Publisher(name, type_name, self._wire.open_writer(name, type_name, qos))

    def subscribe(
        self, topic: str, type_name: str, callback: Callable[[Any], Any], *, qos: QoS = DEFAULT
    ) -> Subscription:
        """Call ``callback(message)`` for every message of a topic; parameters as for :meth:`publisher`."""
        name = self.resolve(topic)
        messages.fields_of(type_name)
        subscription = Subscription(name, type_name)

        def deliver(data: bytes) -> None:
            try:
                message = messages.decode(type_name, data)
            except RosError as error:
                subscription.undecodable += 1
                if subscription.undecodable.bit_count() == 1:  # the 1st, 2nd, 4th, 8th ...: never a flood
                    self.log("warn", f"{name}: sample dropped, the {subscription.undecodable}. so far: {error}")
                return
            self._run(f"callback of {name}", lambda: callback(message))

        subscription._reader = self._wire.open_reader(name, type_name, qos, deliver)
        return subscription

    # Services

    def serve(self, name: str, type_name: str, callback: Callable[[Any], Mapping[str, Any] | object]) -> Service:
        """Answer a service: ``callback(request)`` returns the fields of the response, or a :class:`Reply` for later.

        A callback that raises gets the caller a response with every field at its default, and the error goes to the
        log: a server must not leave a caller waiting for ever.
        """
        resolved = self.resolve(name)
        request_type, response_type = f"{type_name}_Request", f"{type_name}_Response"
        messages.fields_of(request_type)

        def answer(data: bytes, respond: Callable[[bytes], None]) -> None:
            answered = False

            def call() -> None:
                nonlocal answered
                response = callback(messages.decode(request_type, data))
                if isinstance(response, Reply):
                    response.open_for(response_type, respond)
                else:
                    respond(messages.encode(response_type, messages.make(response_type, response)))
                answered = True

            self._run(f"service {resolved}", call)
            if not answered:
                respond(messages.encode(response_type, messages.make(response_type)))

        service = Service(resolved, type_name)
        service._server = self._wire.open_server(resolved, type_name, answer)
        return service

    def client(self, name: str, type_name: str) -> Client:
        """Make a client of a service."""
        resolved = self.resolve(name)
        messages.fields_of(f"{type_name}_Request")
        return Client(resolved, type_name, self._wire.open_caller(resolved, type_name), self._run)

    def call(
        self, client: Client, timeout: float, message: Mapping[str, Any] | object | None = None, /, **fields: Any
    ) -> Any:
        """Wait for the server, send the request, spin until the answer is here, and return it.

        Not from inside a callback: there, use `Client.send`.

        Parameters
        ----------
        client : Client
            From :meth:`client`.
        timeout : float
            Seconds, for the server to appear and to answer.
        message : mapping or message, optional
            The request, where it is not given by its fields.
        **fields
            Fields of the request by name.

        Returns
        -------
        message
            The answer of the server.

        Raises
        ------
        TimeoutError
            No server, or no answer in time; the message says which.
        """
        deadline = self._seconds() + timeout
        if not self.spin_until(lambda: client.ready, timeout=timeout):
            raise TimeoutError(f"no server for {client.name} ({client.type}) within {timeout:g} s")
        answers: list[Any] = []
        client.send(answers.append, message, **fields)
        if not self.spin_until(lambda: bool(answers), timeout=max(0.0, deadline - self._seconds())):
            raise TimeoutError(f"no answer from {client.name} ({client.type}) within {timeout:g} s")
        return answers[0]

    # Time

    def timer(self, period: float, callback: Callable[[], Any]) -> Timer:
        """Call ``callback()`` every ``period`` seconds of the bus's clock, first after one period.

        A timer that has fallen behind is called once and goes on from there; missed calls are not made up for.

        Raises
        ------
        RosError
            The period is not positive and finite.
        """
        if not 0.0 < period < float("inf"):
            raise RosError(f"the period of a timer must be positive and finite, in seconds; got {period!r}")
        timer = Timer(period, self.now() + round(period * 1e9), callback)
        self._schedule(timer)
        return timer

    def now(self) -> int:
        """Nanoseconds since 1970 by the clock of the bus: the system's, or ``/clock`` with ``use_sim_time``."""
        if self._use_sim_time.value:
            if self._clock is None:
                self._clock = self.subscribe("/clock", "rosgraph_msgs/msg/Clock", self._on_clock, qos=CLOCK)
            return self._sim_time
        return self._system_time()

    def stamp(self) -> dict[str, int]:
        """Return :meth:`now` as the fields of ``builtin_interfaces/msg/Time``."""
        seconds, nanoseconds = divmod(self.now(), 1_000_000_000)
        return {"sec": seconds, "nanosec": nanoseconds}

    # Parameters and log

    def parameter(
        self,
        name: str,
        default: Any,
        *,
        description: str = "",
        check: Callable[[Any], Any] | None = None,
        read_only: bool = False,
    ) -> Parameter[Any]:
        """Declare a parameter; its type is that of the default.

        Others may set it while the node runs, so read ``.value`` when it is needed.

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

        Returns
        -------
        Parameter
            Its ``.value`` is what it is now.

        Raises
        ------
        RosError
            The value given at the start has another type or is refused; the name is declared twice.
        """
        return self._parameters.declare(name, default, description=description, check=check, read_only=read_only)

    @property
    def parameters(self) -> Mapping[str, Parameter[Any]]:
        """The parameters that are declared, by name."""
        return self._parameters.declared

    def log(self, level: str, text: str) -> None:
        """Write a line to standard error and to ``/rosout``; ``level`` is debug, info, warn, error or fatal.

        Raises
        ------
        RosError
            There is no such level.
        """
        if level not in _LEVELS:
            raise RosError(f"no log level {level!r}; levels are: {', '.join(_LEVELS)}")
        if _LEVELS[level] < self._threshold:
            return
        stamp = self.stamp()
        text = text.encode("utf-8", "replace").decode().replace("\0", " ")  # what a message can carry
        name = f"{self.namespace}/{self.node}".strip("/").replace("/", ".")
        self._print(f"[{level.upper()}] [{stamp['sec']}.{stamp['nanosec']:09d}] [{name}]: {text}")
        if not self._closed:
            self._rosout.send(stamp=stamp, level=_LEVELS[level], name=name, msg=text)

    # Life

    def spin_once(self, timeout: float | None = None) -> None:
        """Wait for something to do, at most ``timeout`` seconds, and do all of it.

        It may return earlier with nothing done, so that signals and timers are seen.
        """
        if not self._ok:
            return
        wanted = float("inf") if timeout is None else timeout
        self._wire.wait(max(0.0, min(wanted, self._until_timer(), _LONGEST_WAIT)))
        self._run_timers()
        if self._use_sim_time.value and not self._sim_time:
            self._miss_clock()
        if time.monotonic() - self._checked >= _CHECK_EVERY and self._ok:
            self._checked = time.monotonic()
            if repaired := self._wire.check():
                self.log("warn", repaired)

    def spin(self) -> None:
        """Handle whatever comes until :meth:`stop`."""
        while self._ok:
            self.spin_once()

    def spin_until(self, condition: Callable[[], bool], *, timeout: float | None = None) -> bool:
        """Spin until ``condition()`` holds; False if it did not within ``timeout`` seconds or the bus was stopped."""
        deadline = float("inf") if timeout is None else self._seconds() + timeout
        while self._ok and not condition():
            remaining = deadline - self._seconds()
            if remaining <= 0.0:
                break
            self.spin_once(min(remaining, 0.01))
        return condition()

    @property
    def ok(self) -> bool:
        """False after :meth:`stop` or :meth:`close`."""
        return self._ok

    def stop(self) -> None:
        """Make :meth:`spin` return soon; safe from any thread and from a signal handler."""
        self._ok = False
        self._wire.wake()

    def close(self) -> None:
        """Leave the network. Closing twice does no harm."""
        if not self._closed:
            self._ok, self._closed = False, True
            self._wire.close()

    def __enter__(self) -> Self:
        """Return the bus itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave the network."""
        self.close()

    # Inner workings

    def _run(self, what: str, callback: Callable[[], Any]) -> None:
        """Call back; whatever it raises goes to the log, and the node goes on."""
        try:
            callback()
        except PieperError as error:
            self.errors.append(error)
            self.log("error", f"{what}: {error}")
        except Exception as error:  # noqa: BLE001  a node must not fall over one bad message
            self.errors.append(error)
            self.log("error", f"{what}: {''.join(traceback.format_exception(error))}")
        del self.errors[:-100]

    def _tell_parameters(self, changed: list[Parameter[Any]]) -> None:
        self._parameter_events.send(
            stamp=self.stamp(),
            node=f"{self.namespace.rstrip('/')}/{self.node}",
            changed_parameters=[{"name": p.name, "value": as_value(p.current)} for p in changed],
        )

    def _run_timers(self) -> None:
        now = self.now()
        if self._use_sim_time.value != self._last_simulated or now < self._last_time:  # another clock, or it was reset
            for _, _, timer in self._timers:
                timer.due = now + round(timer.period * 1e9)
            self._timers = [(timer.due, order, timer) for _, order, timer in self._timers]
            heapq.heapify(self._timers)
        self._last_time, self._last_simulated = now, self._use_sim_time.value
        due = []
        while self._timers and self._timers[0][0] <= now:
            due.append(heapq.heappop(self._timers)[2])
        for timer in due:
            if self._ok and not timer.cancelled:
                self._run("timer", timer.callback)
                period = max(1, round(timer.period * 1e9))
                timer.due += period * max(1, (now - timer.due) // period + 1)
                self._schedule(timer)

    def _schedule(self, timer: Timer) -> None:
        heapq.heappush(self._timers, (timer.due, next(self._tie_break), timer))

    def _until_timer(self) -> float:
        """Seconds until the next timer is due; infinite if there is none, or if /clock will say."""
        while self._timers and self._timers[0][2].cancelled:
            heapq.heappop(self._timers)
        if not self._timers or self._use_sim_time.value:
            return float("inf")
        return max(0.0, (self._timers[0][0] - self.now()) * 1e-9)

    def _miss_clock(self) -> None:
        """Say once that time stands still, when that has lasted for a while."""
        if self._clockless_since is None:
            self._clockless_since = self._seconds()
        elif self._seconds() - self._clockless_since > _CLOCK_EXPECTED:
            self._clockless_since = float("inf")
            self.log(
                "warn",
                "use_sim_time is true and nothing has come on /clock: time stands still, and so does this node; "
                "start the simulator, or set use_sim_time to false",
            )

    def _on_clock(self, message: Any) -> None:
        self._sim_time = int(message.clock.sec) * 1_000_000_000 + int(message.clock.nanosec)

    # What a bus for tests does in its own way

    def _system_time(self) -> int:
        return time.time_ns()

    def _seconds(self) -> float:
        return time.monotonic()

    def _print(self, line: str) -> None:
        with suppress(OSError, ValueError):  # a full disk, or nobody who reads: the node goes on
            print(line, file=sys.stderr, flush=True)  # noqa: T201  where a node's log goes
