"""A network inside one process, with a clock that the test turns: for tests of nodes.

Every byte takes the same way as on a real network (fields to CDR and back), and quality of service is honoured: latched
samples, depths, and the rule that a reliable or latched subscriber does not hear a publisher that is not.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

from pieper.errors import RosError
from pieper.ros.arguments import Arguments, parse
from pieper.ros.bus import Bus
from pieper.ros.wire import LEFT

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from pieper.ros.qos import QoS


@dataclass(eq=False)
class _Writer:
    network: FakeNetwork
    topic: str
    type: str
    qos: QoS
    kept: deque[bytes]

    def write(self, data: bytes) -> None:
        if self.qos.transient_local:
            self.kept.append(data)
        for reader in self.network.readers_of(self):
            reader.inbox.append(data)

    @property
    def matched(self) -> int:
        return len(self.network.readers_of(self))

    def close(self) -> None:
        if self in self.network.writers:
            self.network.writers.remove(self)


@dataclass(eq=False)
class _Reader:
    network: FakeNetwork
    topic: str
    type: str
    qos: QoS
    deliver: Callable[[bytes], None]
    inbox: deque[bytes]

    @property
    def matched(self) -> int:
        return sum(self in self.network.readers_of(writer) for writer in self.network.writers)

    def close(self) -> None:
        if self in self.network.readers:
            self.network.readers.remove(self)
        self.inbox.clear()


@dataclass(eq=False)
class _Server:
    network: FakeNetwork
    service: str
    type: str
    answer: Callable[[bytes, Callable[[bytes], None]], None]
    inbox: deque[tuple[bytes, _Caller, Callable[[bytes], None]]] = field(default_factory=lambda: deque(maxlen=100))

    def respond(self, caller: _Caller, deliver: Callable[[bytes], None], response: bytes) -> None:
        if self in self.network.servers:
            caller.inbox.append((deliver, response))

    def close(self) -> None:
        if self in self.network.servers:
            self.network.servers.remove(self)
        self.inbox.clear()


@dataclass(eq=False)
class _Caller:
    network: FakeNetwork
    service: str
    type: str
    inbox: deque[tuple[Callable[[bytes], None], bytes]] = field(default_factory=deque)
    open: bool = True

    def send(self, request: bytes, deliver: Callable[[bytes], None]) -> None:
        for server in self.network.servers_of(self)[:1]:
            server.inbox.append((request, self, deliver))

    @property
    def ready(self) -> bool:
        return bool(self.network.servers_of(self))

    def close(self) -> None:
        self.open = False
        self.inbox.clear()


@dataclass(eq=False)
class FakeNetwork:
    """A network that fake buses share, and its clock.

    Attributes
    ----------
    time : int
        Nanoseconds since 1970; :meth:`advance` moves it.
    """

    time: int = 1_000_000_000 * 10**9
    readers: list[_Reader] = field(default_factory=list)
    writers: list[_Writer] = field(default_factory=list)
    servers: list[_Server] = field(default_factory=list)
    buses: list[FakeBus] = field(default_factory=list)

    def bus(self, node: str, arguments: Sequence[str] = ()) -> FakeBus:
        """Make a node on this network; ``arguments`` as on a command line, from ``--ros-args`` on."""
        return FakeBus(self, node, parse(list(arguments), node_name=node))

    def advance(self, seconds: float, *, step: float = 0.001) -> None:
        """Let time pass for all nodes, in steps [s], and deliver everything that is sent meanwhile."""
        end = self.time + round(seconds * 1e9)
        self.settle()
        while self.time < end:
            self.time = min(end, self.time + round(step * 1e9))
            self.settle()

    def settle(self) -> None:
        """Let every node work until nothing is under way, without time passing."""
        for _ in range(1000):
            if not sum(bus.work() for bus in list(self.buses)):
                return
        raise RuntimeError("the nodes of this network answer each other for ever")

    def readers_of(self, writer: _Writer) -> list[_Reader]:
        """Readers that hear this writer."""
        if writer not in self.writers:
            return []
        return [
            r for r in self.readers if (r.topic, r.type) == (writer.topic, writer.type) and _fits(writer.qos, r.qos)
        ]

    def servers_of(self, caller: _Caller) -> list[_Server]:
        """Servers that answer this caller."""
        if not caller.open:
            return []
        return [s for s in self.servers if (s.service, s.type) == (caller.service, caller.type)]


def _fits(offered: QoS, wanted: QoS) -> bool:
    return offered.reliable >= wanted.reliable and offered.transient_local >= wanted.transient_local


class _FakeWire:
    """One node's connection to a fake network."""

    def __init__(self, network: FakeNetwork) -> None:
        self.network = network
        self.endpoints: list[Any] = []
        self.open = True

    def open_writer(self, topic: str, type_name: str, qos: QoS) -> _Writer:
        writer = _Writer(self.network, topic, type_name, qos, deque(maxlen=qos.depth))
        self.enter(writer)
        self.network.writers.append(writer)
        return writer

    def open_reader(self, topic: str, type_name: str, qos: QoS, deliver: Callable[[bytes], None]) -> _Reader:
        reader = _Reader(self.network, topic, type_name, qos, deliver, deque(maxlen=qos.depth))
        self.enter(reader)
        self.network.readers.append(reader)
        if qos.transient_local:
            for writer in self.network.writers:
                if reader in self.network.readers_of(writer):
                    reader.inbox.extend(writer.kept)
        return reader

    def open_server(
        self, service: str, type_name: str, answer: Callable[[bytes, Callable[[bytes], None]], None]
    ) -> _Server:
        server = _Server(self.network, service, type_name, answer)
        self.enter(server)
        self.network.servers.append(server)
        return server

    def open_caller(self, service: str, type_name: str) -> _Caller:
        caller = _Caller(self.network, service, type_name)
        self.enter(caller)
        return caller

    def enter(self, endpoint: Any) -> None:
        if not self.open:
            raise RosError(LEFT)
        self.endpoints.append(endpoint)

    def deliver(self) -> int:
        """Deliver what is there; return how much it was."""
        count = 0
        for endpoint in list(self.endpoints):
            for _ in range(len(getattr(endpoint, "inbox", ()))):
                if not endpoint.inbox:  # closed by what was delivered
                    break
                count += 1
                item = endpoint.inbox.popleft()
                if isinstance(endpoint, _Reader):
                    endpoint.deliver(item)
                elif isinstance(endpoint, _Server):
                    request, caller, deliver = item
                    endpoint.answer(request, partial(endpoint.respond, caller, deliver))
                elif endpoint.open:
                    deliver, response = item
                    deliver(response)
        return count

    def wait(self, timeout: float) -> None:
        if not self.deliver():
            self.network.time += round(min(timeout, 0.001) * 1e9)
            for bus in list(self.network.buses):
                if bus.wire is not self:
                    bus.work()
            self.deliver()

    def wake(self) -> None:
        """Nothing waits here."""

    def check(self) -> str | None:
        return None

    def close(self) -> None:
        self.open = False
        for endpoint in self.endpoints:
            endpoint.close()


class FakeBus(Bus):
    """A node on a :class:`FakeNetwork`.

    Attributes
    ----------
    lines : list of str
        Everything that it logged.
    """

    def __init__(self, network: FakeNetwork, node: str, arguments: Arguments) -> None:
        self.network, self.lines = network, []  # type: tuple[FakeNetwork, list[str]]
        self.wire = _FakeWire(network)
        super().__init__(self.wire, node=node, arguments=arguments, backend="fake")
        network.buses.append(self)

    def work(self) -> int:
        """Do what there is to do now, without waiting; return how much it was."""
        if not self.ok:
            return 0
        count = self.wire.deliver()
        self._run_timers()
        return count

    def close(self) -> None:
        """Leave the network."""
        super().close()
        if self in self.network.buses:
            self.network.buses.remove(self)

    def _system_time(self) -> int:
        return self.network.time

    def _seconds(self) -> float:
        return self.network.time * 1e-9

    def _print(self, line: str) -> None:
        self.lines.append(line.partition("]: ")[2])
