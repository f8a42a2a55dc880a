"""The two ends of a DDS topic. They move bytes, and can leave a participant and come back on another one."""

from __future__ import annotations

import math
import time
from collections import deque
from typing import TYPE_CHECKING, Any

from cyclonedds._clayer import ddspy_take
from cyclonedds.core import DDSException
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader

from pieper.errors import RosError
from pieper.ros.bare import cyclone
from pieper.ros.bare.endpoint import Endpoint
from pieper.ros.bare.loopback import LARGEST_SAMPLE
from pieper.ros.bare.participant import ANY
from pieper.ros.bare.qos import POLICIES, reader_policies, writer_policies

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from pieper.ros.bare.participant import Participant
    from pieper.ros.bare.watchdog import Ear
    from pieper.ros.qos import QoS

_BATCH = 256


class TopicWriter(Endpoint):
    """Sends the samples of one topic.

    Parameters
    ----------
    name : str
        Of the DDS topic, ``"rt/joint_states"``.
    kind : IDL class
        From :func:`pieper.ros.bare.type_support.describe`.
    qos : QoS
        Quality of service.
    user_data : str
        What other nodes read about this writer.

    Attributes
    ----------
    dropped : int
        Samples that were given up because a reliable subscriber did not keep up.
    """

    def __init__(self, name: str, kind: Any, qos: QoS, user_data: str) -> None:
        self.name = name
        self.dropped = 0
        self._told = 0
        self._kind = kind
        self._qos = qos
        self._user_data = user_data
        self._dds: Any = None
        self._participant: Participant | None = None
        self._kept: deque[tuple[float, bytes]] = deque(maxlen=qos.depth)

    def open(self, participant: Participant) -> None:
        """Enter a participant; what late subscribers are owed is sent again."""
        topic = participant.topic(self.name, self._kind)
        try:
            self._dds = DataWriter(participant.dds, topic, writer_policies(self._qos, self._user_data))
        except DDSException as error:
            raise RosError(f"Cyclone DDS could not make a writer of {self.name!r}: {error}") from error
        self._participant = participant
        oldest = time.monotonic() - self._qos.lifespan
        for written, data in list(self._kept):
            if written >= oldest:
                self._send(data)

    def write(self, data: bytes) -> None:
        """Send one sample: CDR with its encapsulation.

        Raises
        ------
        RosError
            The bytes are not a sample of this type, or too many.
        """
        if len(data) > LARGEST_SAMPLE:
            raise RosError(f"{self.name}: a sample has at most {LARGEST_SAMPLE} bytes, and this one has {len(data)}")
        self._send(data)
        if self._qos.transient_local:
            self._kept.append((time.monotonic() if math.isfinite(self._qos.lifespan) else math.inf, data))

    def _send(self, data: bytes) -> None:
        if self._dds is None or self._participant is None:
            return
        size = (len(data) + 3) & ~3  # RTPS wants multiples of four
        code = cyclone.write(self._dds._ref, cyclone.Sample(data.ljust(size, b"\0"), size))
        if code == cyclone.TIMEOUT or (code < 0 and not self._participant.alive):
            self.dropped += 1
        elif code == cyclone.BAD_PARAMETER:
            raise RosError(f"Cyclone DDS refuses {len(data)} bytes as a sample of {self.name!r}")
        else:
            cyclone.checked(code, f"writing {self.name!r}")

    @property
    def reader_guids(self) -> Sequence[bytes]:
        """None."""
        return ()

    @property
    def writer_guids(self) -> Sequence[bytes]:
        """Its own."""
        return () if self._dds is None else (bytes(self._dds.guid.bytes),)

    @property
    def matched(self) -> int:
        """Number of readers that are matched now."""
        alive = self._participant is not None and self._participant.alive
        return cyclone.matched_readers(self._dds) if alive else 0

    @property
    def acknowledged(self) -> bool:
        """Whether all reliable readers have all that was written; if not, leaving waits for them up to a second."""
        return self._dds is None or cyclone.acknowledged(self._dds)

    def complaint(self) -> str | None:
        """Return a sentence about samples that were given up, or about a reader that wants what is not offered."""
        lost, self._told = self.dropped - self._told, self.dropped
        if lost:
            return f"{_in_ros(self.name)}: {lost} samples were given up because a subscriber does not keep up"
        policy = None if self._dds is None else cyclone.refused_readers(self._dds)
        if policy is None:
            return None
        what = POLICIES.get(policy, f"policy {policy}")
        return (
            f"{_in_ros(self.name)}: a subscriber asks for another {what} than this node offers, and hears nothing of it"
        )

    def matched_user_data(self) -> list[bytes]:
        """Return what the matched readers tell of themselves."""
        return [] if self._dds is None else cyclone.user_data_of_readers(self._dds)

    def leave(self) -> None:
        """Leave the participant."""
        cyclone.delete(self._dds)
        self._dds = self._participant = None


class TopicReader(Endpoint):
    """Hands over the samples of one topic.

    Parameters
    ----------
    name, kind, qos, user_data
        As for :class:`TopicWriter`.
    deliver : callable
        ``deliver(data, writer)`` with the sample as it came, and a number for the writer it came from.
    """

    def __init__(self, name: str, kind: Any, qos: QoS, user_data: str, deliver: Callable[[bytes, int], None]) -> None:
        self.name = name
        self._kind = kind
        self._qos = qos
        self._user_data = user_data
        self._deliver = deliver
        self._dds: Any = None
        self._participant: Participant | None = None
        self._key = 0
        self._ear: Ear | None = None

    def open(self, participant: Participant) -> None:
        """Enter a participant."""
        topic = participant.topic(self.name, self._kind)
        try:
            self._dds = DataReader(participant.dds, topic, reader_policies(self._qos, self._user_data))
        except DDSException as error:
            raise RosError(f"Cyclone DDS could not make a reader of {self.name!r}: {error}") from error
        self._participant = participant
        self._key = participant.attach(self._dds, self._take)
        self._ear = participant.watchdog.watch(self._dds, self.name)

    def _take(self) -> None:
        reader = self._dds
        samples = ddspy_take(reader._ref, ANY, _BATCH)
        if isinstance(samples, int):
            cyclone.checked(samples, f"reading {self.name!r}")
            return
        deliver = self._deliver
        if self._ear is not None:
            self._ear.heard.update(info.publication_handle for _, info in samples)
        for data, info in samples:
            if self._dds is not reader:  # closed or opened anew by what was delivered
                return
            if info.valid_data:
                deliver(data, info.publication_handle)

    @property
    def reader_guids(self) -> Sequence[bytes]:
        """Its own."""
        return () if self._dds is None else (bytes(self._dds.guid.bytes),)

    @property
    def writer_guids(self) -> Sequence[bytes]:
        """None."""
        return ()

    @property
    def matched(self) -> int:
        """Number of writers that are matched now."""
        alive = self._participant is not None and self._participant.alive
        return cyclone.matched_writers(self._dds) if alive else 0

    def asks_less_than(self, other: TopicReader) -> bool:
        """Whether it hears all writers of the same topic that the other one hears, and some that the other one does not."""
        mine, its = ((q.reliable, q.transient_local) for q in (self._qos, other._qos))
        return self.name == other.name and mine != its and all(a <= b for a, b in zip(mine, its, strict=True))

    def complaint(self) -> str | None:
        """Return a sentence about a writer that does not offer what this reader wants."""
        policy = None if self._dds is None else cyclone.refused_writers(self._dds)
        if policy is None:
            return None
        what = POLICIES.get(policy, f"policy {policy}")
        return f"{_in_ros(self.name)}: a publisher offers another {what} than this node asks for, and is not heard"

    def matched_user_data(self) -> list[bytes]:
        """Return what the matched writers tell of themselves."""
        return [] if self._dds is None else cyclone.user_data_of_writers(self._dds)

    def user_data_of(self, writer: int) -> bytes | None:
        """Return what a matched writer tells of itself; None if it is gone."""
        return None if self._dds is None else cyclone.user_data_of_writer(self._dds, writer)

    def leave(self) -> None:
        """Leave the participant."""
        if self._participant is not None:
            self._participant.detach(self._key)
            if self._ear is not None:
                self._participant.watchdog.unwatch(self._ear)
            self._participant = self._ear = None
        cyclone.delete(self._dds)
        self._dds = None


def _in_ros(topic: str) -> str:
    """Name in ROS of a topic of DDS; the two topics of a service have none."""
    return topic.removeprefix("rt")
