"""Whether this process still hears what it should: three ways to go deaf in DDS, and what tells of each.

*The receive thread stands still.* Then the same datagram stays at the head of a receive queue. `Watchdog` sends each queue a
datagram of its own, so that there is one, and looks at the head.

*A writer is taken to be further than it is.* One forged datagram (a HEARTBEAT or GAP, or for best-effort readers a DATA, with a
sequence number far ahead, in the name of a writer) makes Cyclone throw away everything that the true writer sends from then on.
The reader stays matched and the application hears nothing. But Cyclone counts what it throws away: the count grows while a
matched writer is silent.

*A participant stays a stranger.* It announces itself, but what it sends and hears never becomes known: a forged announcement gave it
an address where nobody is, or its tellings were numbered wrong like the samples above. `peers.Peers` knows those.

All are healed by closing the domain, opening it again and creating every entity anew: peers then see a new participant, and
announce everything to it. To leave the domain open and make a new participant is not enough: Cyclone keeps what it knows of the
writers for all participants of a process. A receive thread that stands still may hold up the closing for ever; then only a new
process heals, and `loopback.close_domain` says so.

A forged goodbye in the name of a participant is healed by that participant's next announcement, within `loopback.ANNOUNCED` seconds. A forged
goodbye of one of its endpoints is not told from a true one.
"""

from __future__ import annotations

import ctypes
import socket
import struct
import time
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from cyclonedds.core import DDSException, Statistics
from cyclonedds.internal import dds_c_t

from pieper.ros.bare import loopback
from pieper.ros.bare.peers import Peers

if TYPE_CHECKING:
    from collections.abc import Callable

    from cyclonedds.domain import Domain, DomainParticipant
    from cyclonedds.sub import DataReader

STILL = 4
"""Checks at which a queue has the same head, or a reader throws away while one of its writers is silent: 2 s."""

LOST = 2
"""Checks at which a reader throws away while all its writers are silent; a writer that seldom sends is missed soon."""

FORGIVEN = 5.0, 600.0
"""Seconds without anything thrown away after which a suspicion ends, when some and when all writers are silent."""

CHANCES = 3
"""Alarms about one and the same stranger: it may be one that neither sends nor hears anything."""

PATIENCE = 1.0, 8.0
"""Seconds from one alarm to the next, at first and at most: doubled by every alarm, and reset after twice as long a peace."""


_STRANGERS = 10_000
"""So many are remembered."""


@dataclass(eq=False)
class Ear:
    """What a watched reader was heard to say.

    Attributes
    ----------
    name : str
        Topic, for the message.
    heard : set of int
        Add ``sample_info.publication_handle`` of every sample taken; the watchdog empties it.
    """

    name: str
    heard: set[int] = field(default_factory=set)
    _reader: Any = None
    _statistics: Any = None
    _index: int = 0
    _discarded: int = 0
    _recent: set[int] = field(default_factory=set)
    _suspicions: int = 0
    _last: float = 0.0

    def discarded(self) -> int:
        """Bytes of samples that Cyclone threw away since the reader matched its writers."""
        counters = self._statistics._c_statistics
        self._statistics._refresh_statistics(ctypes.cast(counters, ctypes.POINTER(dds_c_t.statistics)))
        return int(counters[0].kv[self._index].u.u64)

    def loses(self, now: float) -> bool:
        """Whether the reader throws away what a silent writer sends, seen at several checks.

        Duplicates are thrown away too (a sample sent again because its receipt was reported late), but then their writer was
        heard in this check or the one before.
        """
        heard, self.heard = self.heard, set()
        window = self._recent | heard
        before, self._discarded = self._discarded, self.discarded()  # falls when a writer leaves
        grew = self._discarded > before
        if not grew and not self._suspicions:
            self._recent = heard
            return False
        self._recent = window  # everybody heard since the first suspicion
        matched = self._matched()
        silent = matched - window
        if grew and silent:
            self._suspicions += 1
            self._last = now
        if not silent or now - self._last > FORGIVEN[silent == matched]:
            self._suspicions = 0
            self._recent = heard
        return self._suspicions >= (LOST if silent == matched else STILL)

    def _matched(self) -> set[int]:
        try:
            return set(self._reader.get_matched_publications())
        except DDSException:  # the reader is being deleted
            return set()


class Watchdog:
    """Notice within a few seconds that this process has gone deaf.

    Parameters
    ----------
    number : int
        ``ROS_DOMAIN_ID``.
    clock : callable
        Seconds, monotonic.

    Examples
    --------
    ::

        dog = Watchdog(0)

        def build():
            domain = loopback.open_domain(0)
            ...                                                  # participant, readers, writers; send latched samples again
            dog.start(domain)
            ear = dog.watch(reader, "/joint_states")             # then, for every sample taken:
            ear.heard.add(sample.sample_info.publication_handle)

        def check():                                             # twice a second
            reason = dog.check()
            if reason:
                dog.stop()
                loopback.close_domain(domain)                    # a RosError: let it end the process
                build()
                return f"deaf: {reason}; participant rebuilt"
    """

    def __init__(self, number: int, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._number = number
        self._clock = clock
        self._domain: Domain | None = None
        self._ears: list[Ear] = []
        self._queues: list[_Queue] = []
        self._peers: Peers | None = None
        self._chances: dict[bytes, int] = {}
        self._knocks = 0
        self._knocker: socket.socket | None = None
        self._since = clock()
        self._alarm = -PATIENCE[1]
        self._patience = PATIENCE[0]

    def start(self, domain: Domain) -> None:
        """Watch a domain, at first or after it was opened again."""
        self.stop()
        self._domain, self._since = domain, self._clock()
        self._knocker = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._knocker.bind(("127.0.0.1", 0))
        self._knocker.setblocking(False)
        self._queues = [_Queue(one) for one in loopback.receivers(self._number)]

    def meet(self, participant: DomainParticipant) -> None:
        """Watch whom a participant of the domain gets to know."""
        self._peers = Peers(participant)

    def stop(self) -> None:
        """Let go of sockets and readers; to be called before the domain is closed."""
        self._domain = self._peers = None
        self._ears.clear()
        if self._knocker is not None:
            self._knocker.close()
            self._knocker = None
        for queue in self._queues:
            queue.close()
        self._queues = []

    def watch(self, reader: DataReader[Any], name: str) -> Ear:
        """Watch a reader; stop with `unwatch` before it is deleted."""
        statistics = Statistics(reader)
        ear = Ear(name, _reader=reader, _statistics=statistics, _index=list(statistics.data).index("discarded_bytes"))
        ear._discarded = ear.discarded()
        self._ears.append(ear)
        return ear

    def unwatch(self, ear: Ear) -> None:
        """Stop watching a reader."""
        if ear in self._ears:
            self._ears.remove(ear)

    def check(self) -> str | None:
        """Look at everything once; to be called about twice a second.

        Returns
        -------
        str or None
            Why this process is deaf, in words; None while it hears, and for a while after the last alarm.
        """
        if self._domain is None:
            return None
        if not loopback.is_open(self._domain, self._number):
            return f"domain {self._number} was closed by another node of this process"
        reason = self._look()
        now = self._clock()
        if reason is None:
            self._since = now
            return None
        if now - self._alarm < self._patience:
            return None
        quiet = now - self._alarm > 2 * PATIENCE[1]
        self._patience = PATIENCE[0] if quiet else min(2 * self._patience, PATIENCE[1])
        self._alarm = now
        if self._peers is not None:
            self._chances = {guid: count for guid, count in self._chances.items() if not self._peers.knows(guid)}
            for guid in self._peers.strangers(now):
                self._chances[guid] = self._chances.get(guid, 0) + 1
            while len(self._chances) > _STRANGERS:
                del self._chances[next(iter(self._chances))]
        return f"{reason}; for {now - self._since:.1f} s or longer"

    def _look(self) -> str | None:
        still = [queue for queue in self._queues if queue.stands_still()]
        self._knock()
        lost = [ear for ear in self._ears if ear.loses(self._clock())]
        if still:
            return f"nothing is taken from the receive queue of UDP port {still[0].port}"
        if lost:
            return f"samples on {lost[0].name} arrive and are thrown away as older than what their writer is said to have sent"
        strangers = [] if self._peers is None else self._peers.strangers(self._clock())
        strangers = [guid for guid in strangers if self._chances.get(guid, 0) < CHANCES]
        if strangers:
            return f"participant {strangers[0].hex()} announces itself, but its topics do not become known"
        return None

    def _knock(self) -> None:
        """Send each receive queue a valid RTPS message that says nothing: a header and a PAD [RTPS 2.5, section 9.4.5.12]."""
        self._knocks += 1
        if self._knocker is None:
            return
        message = (
            b"RTPS\x02\x01\x01\x10" + b"pieper knock" + struct.pack("<BBHI", 0x01, 0x01, 4, self._knocks & 0xFFFFFFFF)
        )
        for queue in self._queues:
            with suppress(OSError):  # no room, no route: then nothing new stands at the head, and that is all
                self._knocker.sendto(message, (queue.address, queue.port))


class _Queue:
    """A receive queue of Cyclone, seen through a second descriptor."""

    def __init__(self, one: loopback.UdpSocket) -> None:
        self.port = one.port
        self.address = "127.0.0.1" if one.address == "0.0.0.0" else one.address
        self._socket = loopback.duplicate(one)
        self._head: tuple[bytes, Any] | None = None
        self._same = 0

    def stands_still(self) -> bool:
        """Look at the head of the queue without taking it: whether it is the one of the last `STILL` checks."""
        try:
            head = self._socket.recvfrom(256, socket.MSG_PEEK | socket.MSG_DONTWAIT)
        except OSError:  # empty
            head = None
        self._same = self._same + 1 if head is not None and head == self._head else 0
        self._head = head
        return self._same >= STILL

    def close(self) -> None:
        self._socket.close()
