"""The wire of a node that has no ROS: its topics and services as DDS endpoints."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, TypeVar

from pieper.errors import RosError
from pieper.ros.bare.discovery import Discovery, hash_told
from pieper.ros.bare.endpoint import Endpoint
from pieper.ros.bare.participant import Participant, domain_id
from pieper.ros.bare.service import Caller, Server
from pieper.ros.bare.topic import TopicReader, TopicWriter
from pieper.ros.bare.type_support import describe
from pieper.ros.bare.watchdog import Watchdog
from pieper.ros.wire import LEFT

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from pieper.ros.qos import QoS

_Kind = TypeVar("_Kind", bound=Endpoint)

_RETRY = 0.01
"""Seconds between two looks whether the client of a response that waits has been discovered."""


class DdsWire:
    """A node on a DDS network; it conforms to :class:`pieper.ros.wire.Wire`.

    Parameters
    ----------
    node, namespace : str
        ``"inverse"`` and ``"/cell2"``, as the graph of ROS shows them.
    domain : int, optional
        Number of the domain; what ``ROS_DOMAIN_ID`` says, and 0 if it says nothing.
    network : bool
        Leave this machine. DDS has no authentication: whoever is on that network can command the node.

    Raises
    ------
    RosError
        The domain cannot be opened; the message says why.
    """

    def __init__(self, node: str, namespace: str = "/", domain: int | None = None, *, network: bool = False) -> None:
        self.domain = domain_id() if domain is None else domain
        self.network = network
        self._endpoints: list[Endpoint] = []
        self._servers: list[Server] = []
        self._identities = 0
        self._participant: Participant | None = None
        self._watchdog = Watchdog(self.domain)
        self._discovery = Discovery(node, namespace)
        self._open()

    # Topics and services

    def open_writer(self, topic: str, type_name: str, qos: QoS) -> TopicWriter:
        """Start sending on a topic."""
        return self._enter(TopicWriter(f"rt{topic}", describe(type_name), qos, hash_told(type_name)))

    def open_reader(self, topic: str, type_name: str, qos: QoS, deliver: Callable[[bytes], None]) -> TopicReader:
        """Start listening to a topic."""

        def pass_on(data: bytes, writer: int) -> None:
            deliver(data)

        return self._enter(TopicReader(f"rt{topic}", describe(type_name), qos, hash_told(type_name), pass_on))

    def open_server(
        self, service: str, type_name: str, answer: Callable[[bytes, Callable[[bytes], None]], None]
    ) -> Server:
        """Start answering a service."""
        server = Server(service, type_name, answer, self._identity(), hash_told(type_name))
        self._servers.append(self._enter(server))
        return server

    def open_caller(self, service: str, type_name: str) -> Caller:
        """Start asking a service."""
        return self._enter(Caller(service, type_name, self._identity(), hash_told(type_name)))

    # Spinning

    def wait(self, timeout: float) -> None:
        """Deliver what is there; if nothing is, wait for something, at most ``timeout`` seconds, and deliver that."""
        holding = [server for server in self._servers if server.waiting]
        if self._participant is not None:
            self._participant.wait(min(timeout, _RETRY) if holding else timeout)
        for server in holding:
            server.send_held()

    def wake(self) -> None:
        """End a :meth:`wait` early; safe from any thread and from a signal handler."""
        participant = self._participant
        if participant is not None:
            participant.wake()

    def check(self) -> str | None:
        """Look after the connection; return a sentence if samples were lost or something had to be repaired."""
        deaf = self._watchdog.check()
        if deaf is None:
            return self._complaints()
        self.rebuild()
        return f"this node was deaf: {deaf}; participant rebuilt, other nodes see it as a new one"

    def _complaints(self) -> str | None:
        complaints = [
            complaint
            for endpoint in self._endpoints
            if (complaint := endpoint.complaint()) and not self._is_heard_otherwise(endpoint)
        ]
        return "; ".join(complaints) or None

    def _is_heard_otherwise(self, endpoint: Endpoint) -> bool:
        """Whether a second reader of the topic takes what this one has to refuse, as those do who listen for latched and for plain samples."""
        readers = (other for other in self._endpoints if isinstance(other, TopicReader))
        return isinstance(endpoint, TopicReader) and any(other.asks_less_than(endpoint) for other in readers)

    # Life

    def rebuild(self) -> None:
        """Leave the network and enter it again with all that this node has there; handles stay as they are.

        Other nodes of this process that are in the same domain do the same at their next :meth:`check`.

        Raises
        ------
        RosError
            The network cannot be left, because a thread of DDS stands still, or not be entered.
        """
        if self._participant is not None:
            self._participant.end_domain()
        self._leave()
        self._open()

    def close(self) -> None:
        """Leave the network with all endpoints. Closing twice does no harm."""
        self._leave()
        self._endpoints.clear()
        self._servers.clear()

    def _open(self) -> None:
        self._participant = Participant(self.domain, network=self.network, watchdog=self._watchdog)
        self._discovery.open(self._participant)
        for endpoint in self._endpoints:
            endpoint.open(self._participant)
        self._tell()

    def _leave(self) -> None:
        if self._participant is None:
            return
        waiting = [writer for writer in self._writers() if not writer.acknowledged]
        if waiting:  # each waits up to a second for a subscriber that may be gone: all at once, not one by one
            with ThreadPoolExecutor(len(waiting)) as pool:
                list(pool.map(TopicWriter.leave, waiting))
        for endpoint in self._endpoints:
            endpoint.leave()
        self._discovery.leave()
        self._participant.close()
        self._participant = None

    def _enter(self, endpoint: _Kind) -> _Kind:
        if self._participant is None:
            raise RosError(LEFT)
        if not self._participant.alive:  # another node of this process had to close the domain
            self._leave()
            self._open()
        endpoint.open(self._participant)
        endpoint.on_close = self._forget
        self._endpoints.append(endpoint)
        self._tell()
        return endpoint

    def _forget(self, endpoint: Endpoint) -> None:
        if endpoint in self._endpoints:
            self._endpoints.remove(endpoint)
            self._tell()
        if endpoint in self._servers:
            self._servers.remove(endpoint)

    def _tell(self) -> None:
        """Tell the graph which readers and writers are this node's."""
        readers = [guid for endpoint in self._endpoints for guid in endpoint.reader_guids]
        writers = [guid for endpoint in self._endpoints for guid in endpoint.writer_guids]
        if self._participant is not None:
            self._discovery.tell(readers, writers)

    def _identity(self) -> bytes:
        """16 bytes that no other service or client has: the participant's, and a count."""
        if self._participant is None:
            raise RosError(LEFT)
        self._identities += 1
        return self._participant.guid[:12] + self._identities.to_bytes(4, "big")

    def _writers(self) -> Iterator[TopicWriter]:
        yield self._discovery.writer
        for endpoint in self._endpoints:
            if isinstance(endpoint, TopicWriter):
                yield endpoint
            elif isinstance(endpoint, Server | Caller):
                yield endpoint.writer
