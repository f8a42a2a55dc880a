"""The wire that rclpy gives, where ROS 2 is installed and sourced.

Only the moving of bytes is rclpy's: topics are published and heard in serialised form, and names, parameters, timers and
the log are those of :class:`~pieper.ros.bus.Bus`, the same on every backend. So the quality of service, the middleware
(any ``RMW_IMPLEMENTATION``) and its security are those of the ROS installation.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from pieper.errors import MissingLibraryError, RosError
from pieper.ros import messages
from pieper.ros.qos import SERVICES
from pieper.ros.wire import LEFT

if TYPE_CHECKING:
    from collections.abc import Callable

    from pieper.ros.qos import QoS

_MOST_PENDING = 1000
"""Requests of one client that may be without an answer; then the oldest is given up."""

_INNER = {  # the hidden parts of an action, as rosidl names them
    "SendGoal": "SendGoalService",
    "GetResult": "GetResultService",
    "FeedbackMessage": "FeedbackMessage",
}


class RclWire:
    """A node of rclpy.

    Parameters
    ----------
    node, namespace : str
        Full name of the node.
    domain : int, optional
        Number of the domain; what ``ROS_DOMAIN_ID`` says, and 0 if it says nothing.

    Attributes
    ----------
    is_open : bool
        False once the node has left the network.

    Raises
    ------
    MissingLibraryError
        rclpy cannot be imported.
    """

    def __init__(self, node: str, *, namespace: str, domain: int | None = None) -> None:
        try:
            import rclpy
            from rclpy.context import Context
            from rclpy.executors import SingleThreadedExecutor
        except ImportError as error:
            raise MissingLibraryError(
                f"rclpy cannot be imported ({error}); source your ROS 2 first (pip brings it as ros-jazzy-rclpy), or take "
                "the other backend: PIEPER_ROS_BACKEND=bare, which needs pip install 'pieper[ros]'"
            ) from error
        self._context = Context()
        rclpy.init(args=[], context=self._context, domain_id=domain)
        self._node = rclpy.create_node(
            node,
            namespace=namespace,
            context=self._context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self.is_open = True
        self._busy = False

    def was_called(self) -> None:
        """Take note that rclpy had something to do."""
        self._busy = True

    @property
    def node(self) -> Any:
        """The node of rclpy.

        Raises
        ------
        RosError
            It has left the network.
        """
        if not self.is_open:
            raise RosError(LEFT)
        return self._node

    def open_writer(self, topic: str, type_name: str, qos: QoS) -> _RclWriter:
        """Start sending on a topic."""
        return _RclWriter(self, topic, type_name, qos)

    def open_reader(self, topic: str, type_name: str, qos: QoS, deliver: Callable[[bytes], None]) -> _RclReader:
        """Start listening to a topic."""
        return _RclReader(self, topic, type_name, qos, deliver)

    def open_server(
        self, service: str, type_name: str, answer: Callable[[bytes, Callable[[bytes], None]], None]
    ) -> _RclServer:
        """Start answering a service."""
        return _RclServer(self, service, type_name, answer)

    def open_caller(self, service: str, type_name: str) -> _RclCaller:
        """Start asking a service."""
        return _RclCaller(self, service, type_name)

    def wait(self, timeout: float) -> None:
        """Let rclpy work; it calls back from here.

        Up to Jazzy, ``spin_once`` makes one callback of all that are due, and with another timeout than the last time it
        forgets the others and begins again with the first topic: whoever floods that topic keeps the services waiting. So
        as long as there is work it is called with the same timeout, none.
        """
        if self._busy and self.is_open:
            self._busy = False
            self._executor.spin_once(timeout_sec=0.0)
        if not self._busy and self.is_open:
            self._executor.spin_once(timeout_sec=timeout)

    def wake(self) -> None:
        """End a wait early."""
        self._executor.wake()

    def check(self) -> str | None:
        """Rclpy looks after its own connection."""
        return None

    def close(self) -> None:
        """Leave the network."""
        import rclpy

        if not self.is_open:
            return
        self.is_open = False
        self._executor.shutdown(timeout_sec=1.0)
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)


class _RclEndpoint:
    """Something that rclpy has made for a node; when it or the node is closed, rclpy refuses to be asked about it."""

    def __init__(self, wire: RclWire) -> None:
        self._wire, self._closed = wire, False

    @property
    def _is_open(self) -> bool:
        return self._wire.is_open and not self._closed

    def close(self) -> None:
        if self._is_open:
            self._closed = True
            self._destroy()

    def _destroy(self) -> None:
        raise NotImplementedError


class _RclWriter(_RclEndpoint):
    def __init__(self, wire: RclWire, topic: str, type_name: str, qos: QoS) -> None:
        super().__init__(wire)
        self._publisher = wire.node.create_publisher(_class(type_name), topic, _profile(qos))

    def write(self, data: bytes) -> None:
        if self._is_open:
            self._publisher.publish(data)  # bytes are taken for an already serialised message

    @property
    def matched(self) -> int:
        return int(self._publisher.get_subscription_count()) if self._is_open else 0

    def _destroy(self) -> None:
        self._wire.node.destroy_publisher(self._publisher)


class _RclReader(_RclEndpoint):
    def __init__(self, wire: RclWire, topic: str, type_name: str, qos: QoS, deliver: Callable[[bytes], None]) -> None:
        super().__init__(wire)
        self._topic = topic

        def callback(data: bytes) -> None:
            wire.was_called()
            deliver(data)

        self._subscription = wire.node.create_subscription(_class(type_name), topic, callback, _profile(qos), raw=True)

    @property
    def matched(self) -> int:
        if not self._is_open:
            return 0
        if hasattr(self._subscription, "get_publisher_count"):
            return int(self._subscription.get_publisher_count())
        return int(self._wire.node.count_publishers(self._topic))  # older: those of another quality of service, too

    def _destroy(self) -> None:
        self._wire.node.destroy_subscription(self._subscription)


class _RclServer(_RclEndpoint):
    """A service whose answers may come later.

    rclpy sends what a callback returns as soon as it returns. A coroutine could wait, but then, in a mutually exclusive
    callback group, the whole node waits with it, and up to Jazzy ``spin_once`` with changing timeouts looks at nothing
    but that coroutine (rclpy issues 1159 and 1405). So the callback returns the promise of a response, and the
    service's ``send_response(response, header)``, which the executor calls with it, sends it once it is there.
    """

    def __init__(
        self,
        wire: RclWire,
        service: str,
        type_name: str,
        answer: Callable[[bytes, Callable[[bytes], None]], None],
    ) -> None:
        from rclpy.serialization import deserialize_message

        super().__init__(wire)
        service_class = _class(type_name)

        def callback(request: Any, _: Any) -> _Promise:
            wire.was_called()
            promise = _Promise()
            answer(_serialized(f"{type_name}_Request", request), promise.keep)
            return promise

        def send(promise: _Promise, header: Any) -> None:
            promise.then(lambda data: self._send(deserialize_message(data, service_class.Response), header))

        self._service = wire.node.create_service(service_class, service, callback, qos_profile=_profile(SERVICES))
        self._send_now = self._service.send_response
        self._service.send_response = send

    def _send(self, response: Any, header: Any) -> None:
        if self._is_open:
            self._send_now(response, header)

    def _destroy(self) -> None:
        self._wire.node.destroy_service(self._service)


class _Promise:
    """Bytes that are there now or later, and what is to be done with them."""

    def __init__(self) -> None:
        self._data: bytes | None = None
        self._use: Callable[[bytes], None] | None = None

    def keep(self, data: bytes) -> None:
        self._data = data
        if self._use is not None:
            self._use(data)

    def then(self, use: Callable[[bytes], None]) -> None:
        self._use = use
        if self._data is not None:
            use(self._data)


class _RclCaller(_RclEndpoint):
    def __init__(self, wire: RclWire, service: str, type_name: str) -> None:
        super().__init__(wire)
        self._type_name, self._class = type_name, _class(type_name)
        self._client = wire.node.create_client(self._class, service, qos_profile=_profile(SERVICES))
        self._pending: dict[Any, None] = {}  # futures, the oldest first

    def send(self, request: bytes, deliver: Callable[[bytes], None]) -> None:
        from rclpy.serialization import deserialize_message

        def done(future: Any) -> None:
            self._wire.was_called()
            self._pending.pop(future, None)
            if self._is_open and future.exception() is None and not future.cancelled():
                deliver(_serialized(f"{self._type_name}_Response", future.result()))

        if not self._is_open:
            return
        if len(self._pending) >= _MOST_PENDING:
            oldest = next(iter(self._pending))
            del self._pending[oldest]
            self._client.remove_pending_request(oldest)
        future = self._client.call_async(deserialize_message(request, self._class.Request))
        self._pending[future] = None
        future.add_done_callback(done)

    @property
    def ready(self) -> bool:
        return self._is_open and bool(self._client.service_is_ready())

    def _destroy(self) -> None:
        self._pending.clear()
        self._wire.node.destroy_client(self._client)


def _serialized(type_name: str, message: Any) -> bytes:
    """The bytes of a message of rclpy; rmw_fastrtps of Jazzy gives more of them than it fills."""
    from rclpy.serialization import serialize_message

    return messages.cut(type_name, serialize_message(message))


def _class(type_name: str) -> Any:
    """The Python class that rosidl generated for a type."""
    package, kind, name = type_name.split("/")
    try:
        module = import_module(f"{package}.{kind}")
        if kind == "action" and "_" in name:
            action, _, part = name.partition("_")
            return getattr(getattr(module, action).Impl, _INNER[part])
        return getattr(module, name)
    except (ImportError, AttributeError, KeyError) as error:
        where = (
            "build ros2/pieper_interfaces in your workspace"
            if package == "pieper_interfaces"
            else (f"install it: apt install ros-$ROS_DISTRO-{package.replace('_', '-')}")
        )
        raise RosError(f"this ROS installation has no {type_name}; {where}, and source the workspace") from error


def _profile(qos: QoS) -> Any:
    from rclpy.duration import Duration
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

    profile = QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=qos.depth,
        reliability=ReliabilityPolicy.RELIABLE if qos.reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if qos.transient_local else DurabilityPolicy.VOLATILE,
    )
    if qos.lifespan != float("inf"):
        profile.lifespan = Duration(nanoseconds=round(qos.lifespan * 1e9))
    return profile
