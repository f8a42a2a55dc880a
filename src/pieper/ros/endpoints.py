"""What a node has on its bus: publishers, subscriptions, services, clients and timers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pieper.errors import RosError
from pieper.ros import messages

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from pieper.ros.wire import Caller, Endpoint, Reader, Writer


class Publisher:
    """The side of a topic that sends; made by :meth:`~pieper.ros.bus.Bus.publisher`.

    Attributes
    ----------
    topic, type : str
        Full name of the topic, and its type.
    """

    def __init__(self, topic: str, type_name: str, writer: Writer) -> None:
        self.topic, self.type, self._writer = topic, type_name, writer

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
        self._writer.write(messages.encode(self.type, messages.make(self.type, message, **fields)))

    @property
    def subscribers(self) -> int:
        """Number of subscribers that are matched now."""
        return self._writer.matched

    def close(self) -> None:
        """Leave the topic."""
        self._writer.close()


class Subscription:
    """The side of a topic that listens; made by :meth:`~pieper.ros.bus.Bus.subscribe`.

    Attributes
    ----------
    topic, type : str
        Full name of the topic, and its type.
    undecodable : int
        Number of samples that were dropped because their bytes did not fit the type.
    """

    _reader: Reader

    def __init__(self, topic: str, type_name: str) -> None:
        self.topic, self.type, self.undecodable = topic, type_name, 0

    @property
    def publishers(self) -> int:
        """Number of publishers that are matched now."""
        return self._reader.matched

    def close(self) -> None:
        """Leave the topic."""
        self._reader.close()


class Service:
    """A service that this node answers; made by :meth:`~pieper.ros.bus.Bus.serve`.

    Attributes
    ----------
    name, type : str
        Full name of the service, and its type.
    """

    _server: Endpoint

    def __init__(self, name: str, type_name: str) -> None:
        self.name, self.type = name, type_name

    def close(self) -> None:
        """Stop answering."""
        self._server.close()


class Reply:
    """An answer to a request that is not there yet: returned by the callback of :meth:`~pieper.ros.bus.Bus.serve`, sent later.

    Examples
    --------
    >>> from pieper.ros.fake import FakeNetwork
    >>> network = FakeNetwork()
    >>> arm, user = network.bus("arm"), network.bus("user")
    >>> reply = Reply()
    >>> service = arm.serve("home", "std_srvs/srv/Trigger", lambda request: reply)
    >>> client = user.client("home", "std_srvs/srv/Trigger")
    >>> client.send(lambda response: print(response.message))
    >>> network.settle()
    >>> reply.send(success=True, message="arrived")
    >>> network.settle()
    arrived
    """

    def __init__(self) -> None:
        self._sent, self._type = False, ""
        self._early: tuple[Mapping[str, Any] | object | None, dict[str, Any]] = None, {}
        self._respond: Callable[[bytes], None] | None = None

    @property
    def sent(self) -> bool:
        """Whether :meth:`send` was called."""
        return self._sent

    def send(self, message: Mapping[str, Any] | object | None = None, /, **fields: Any) -> None:
        """Answer, with fields as for `Publisher.send`; from the thread that spins the bus, and once.

        Raises
        ------
        RosError
            It was answered before, a field is unknown to the response, or a value does not fit its field.
        """
        if self._sent:
            raise RosError("this request was answered before; a service gives one answer to each request")
        if self._respond is None:
            self._early = message, fields
        else:
            self._respond(messages.encode(self._type, messages.make(self._type, message, **fields)))
        self._sent = True

    def open_for(self, type_name: str, respond: Callable[[bytes], None]) -> None:
        """Take the way back to the caller; if the answer is there already, send it.

        Raises
        ------
        RosError
            It answers another request already.
        """
        if self._respond is not None:
            raise RosError("a Reply answers one request; return a new one for each")
        self._type, self._respond = type_name, respond
        if self._sent:
            message, fields = self._early
            respond(messages.encode(type_name, messages.make(type_name, message, **fields)))


class Client:
    """A service that another node answers; made by :meth:`~pieper.ros.bus.Bus.client`.

    Attributes
    ----------
    name, type : str
        Full name of the service, and its type.
    """

    def __init__(
        self, name: str, type_name: str, caller: Caller, run: Callable[[str, Callable[[], Any]], None]
    ) -> None:
        self.name, self.type, self._caller, self._run = name, type_name, caller, run

    @property
    def ready(self) -> bool:
        """Whether a server is there now."""
        return self._caller.ready

    def send(
        self, on_reply: Callable[[Any], Any], message: Mapping[str, Any] | object | None = None, /, **fields: Any
    ) -> None:
        """Send a request; ``on_reply(response)`` is called from the spin when the answer is here.

        Raises
        ------
        RosError
            A field is unknown to the request, or a value does not fit.
        """
        request = messages.make(f"{self.type}_Request", message, **fields)

        def deliver(data: bytes) -> None:
            self._run(f"answer of {self.name}", lambda: on_reply(messages.decode(f"{self.type}_Response", data)))

        self._caller.send(messages.encode(f"{self.type}_Request", request), deliver)

    def close(self) -> None:
        """Forget the service; answers that are still to come are dropped."""
        self._caller.close()


class Timer:
    """Something that happens again and again; made by :meth:`~pieper.ros.bus.Bus.timer`.

    Attributes
    ----------
    period : float
        Seconds between two calls.
    """

    def __init__(self, period: float, due: int, callback: Callable[[], Any]) -> None:
        self.period, self.due, self.callback, self.cancelled = period, due, callback, False

    def cancel(self) -> None:
        """No more calls."""
        self.cancelled = True
