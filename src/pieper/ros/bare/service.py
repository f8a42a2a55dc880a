"""The two ends of a service, as ``rmw_cyclonedds`` makes them of two topics.

Requests go over ``rq/<name>Request`` and responses over ``rr/<name>Reply``. Before the fields of both stand 16 bytes that
say which client asked and which of its requests it was; the server copies them back.
"""

from __future__ import annotations

import secrets
import struct
import time
from collections import deque
from functools import partial
from typing import TYPE_CHECKING, Any

from pieper.ros.bare.endpoint import Endpoint
from pieper.ros.bare.topic import TopicReader, TopicWriter
from pieper.ros.bare.type_support import describe
from pieper.ros.qos import QoS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from pieper.ros.bare.participant import Participant

QUEUE = QoS(depth=1000)
"""Of requests and responses on either side: whoever sends more at once loses the oldest."""

PATIENCE = 1.0
"""Seconds that a response waits for the client's reader to be discovered before it is sent without knowing."""

_HEADER = struct.Struct("=8sq")
_ENCAPSULATION = 4
_BODY = _ENCAPSULATION + _HEADER.size
_MOST_PENDING = 1000
_MOST_KNOWN = 1000


class _TwoTopics(Endpoint):
    """An endpoint that reads one topic and writes another."""

    reader: TopicReader
    writer: TopicWriter

    def leave(self) -> None:
        """Leave the participant."""
        self.reader.leave()
        self.writer.leave()

    def complaint(self) -> str | None:
        """Return a sentence about what went wrong at either topic."""
        return self.reader.complaint() or self.writer.complaint()

    @property
    def reader_guids(self) -> Sequence[bytes]:
        """That of its reader."""
        return self.reader.reader_guids

    @property
    def writer_guids(self) -> Sequence[bytes]:
        """That of its writer."""
        return self.writer.writer_guids


class Server(_TwoTopics):
    """Answers a service.

    Parameters
    ----------
    service, type_name : str
        ``"/cell2/calculate_ik"`` and for example ``"std_srvs/srv/SetBool"``.
    answer : callable
        ``answer(request, respond)`` calls ``respond(response)`` once, at once or later; both as CDR with its encapsulation.
    identity : bytes
        16 bytes that no other service or client has.
    user_data : str
        What other nodes read about both topics, besides the identity.
    """

    def __init__(
        self,
        service: str,
        type_name: str,
        answer: Callable[[bytes, Callable[[bytes], None]], None],
        identity: bytes,
        user_data: str,
    ) -> None:
        told = _tell("serviceid", identity, user_data)
        request, response = _topics(service, type_name)
        self.writer = TopicWriter(*response, QUEUE, told)
        self.reader = TopicReader(*request, QUEUE, told, self._on_request)
        self._answer = answer
        self._known: dict[int, None] = {}
        self._held: deque[tuple[float, int, bytes]] = deque(maxlen=QUEUE.depth)

    def open(self, participant: Participant) -> None:
        """Enter a participant."""
        self._known.clear()
        self._held.clear()
        self.writer.open(participant)
        self.reader.open(participant)

    def _on_request(self, data: bytes, writer: int) -> None:
        if len(data) < _BODY:
            return
        self._answer(data[:_ENCAPSULATION] + data[_BODY:], partial(self._respond, data[_ENCAPSULATION:_BODY], writer))

    def _respond(self, header: bytes, writer: int, response: bytes) -> None:
        reply = response[:_ENCAPSULATION] + header + response[_ENCAPSULATION:]
        if self._hears(writer):
            self.writer.write(reply)
        else:
            self._held.append((time.monotonic() + PATIENCE, writer, reply))

    @property
    def waiting(self) -> bool:
        """Whether a response waits for its client's reader."""
        return bool(self._held)

    def send_held(self) -> None:
        """Send the responses whose clients can hear them by now, and those that have waited long enough."""
        held = list(self._held)
        self._held.clear()
        now = time.monotonic()
        for until, writer, reply in held:
            if now >= until or self._hears(writer):
                self.writer.write(reply)
            else:
                self._held.append((until, writer, reply))

    def _hears(self, writer: int) -> bool:
        """Whether the client that owns this writer of requests has its reader of responses matched."""
        if writer in self._known:
            return True
        told = self.reader.user_data_of(writer)
        client = None if told is None else _value(told, b"clientid")
        if client is not None and all(
            _value(other, b"clientid") != client for other in self.writer.matched_user_data()
        ):
            return False
        if len(self._known) >= _MOST_KNOWN:
            self._known.clear()
        self._known[writer] = None
        return True


class Caller(_TwoTopics):
    """Asks a service; parameters as for :class:`Server`."""

    def __init__(self, service: str, type_name: str, identity: bytes, user_data: str) -> None:
        told = _tell("clientid", identity, user_data)
        request, response = _topics(service, type_name)
        self.writer = TopicWriter(*request, QUEUE, told)
        self.reader = TopicReader(*response, QUEUE, told, self._on_response)
        self._identity = secrets.token_bytes(8)
        self._sequence = 0
        self._pending: dict[int, Callable[[bytes], None]] = {}

    def open(self, participant: Participant) -> None:
        """Enter a participant."""
        self.reader.open(participant)
        self.writer.open(participant)

    def send(self, request: bytes, deliver: Callable[[bytes], None]) -> None:
        """Send a request; ``deliver(response)`` is called when its answer is here.

        A thousand requests may be without an answer; then the oldest is given up.
        """
        self._sequence += 1
        if len(self._pending) >= _MOST_PENDING:
            del self._pending[next(iter(self._pending))]
        self._pending[self._sequence] = deliver
        header = _HEADER.pack(self._identity, self._sequence)
        self.writer.write(request[:_ENCAPSULATION] + header + request[_ENCAPSULATION:])

    def _on_response(self, data: bytes, writer: int) -> None:
        if len(data) < _BODY:
            return
        identity, sequence = _HEADER.unpack_from(data, _ENCAPSULATION)
        deliver = self._pending.pop(sequence, None) if identity == self._identity else None
        if deliver is not None:
            deliver(data[:_ENCAPSULATION] + data[_BODY:])

    @property
    def ready(self) -> bool:
        """Whether one server is matched in both directions."""
        if not (self.writer.matched and self.reader.matched):
            return False
        hear = {_value(data, b"serviceid") for data in self.writer.matched_user_data()}
        speak = {_value(data, b"serviceid") for data in self.reader.matched_user_data()}
        return bool(hear & speak)

    def close(self) -> None:
        """Leave the network; requests without an answer stay so."""
        self._pending.clear()
        super().close()


def _topics(service: str, type_name: str) -> tuple[tuple[str, Any], tuple[str, Any]]:
    """Names and types of the topics of requests and of responses."""
    return (
        (f"rq{service}Request", describe(f"{type_name}_Request", with_header=True)),
        (f"rr{service}Reply", describe(f"{type_name}_Response", with_header=True)),
    )


def _tell(key: str, identity: bytes, user_data: str) -> str:
    return f"{key}={identity.hex('.')};{user_data}"


def _value(user_data: bytes, key: bytes) -> bytes | None:
    """Return the value of a key in ``key=value;...``."""
    for part in user_data.split(b";"):
        name, separator, value = part.partition(b"=")
        if separator and name == key:
            return value
    return None
