"""Participants that are known by name only: they announce themselves, and what they send and hear never becomes known.

Every participant of ROS has writers and readers, ``ros_discovery_info`` before all, and tells of them once, to each participant that
it gets to know. Where somebody has forged an address of the participant, or the numbers of its tellings, they never arrive, and
Cyclone does not ask again.
"""

from __future__ import annotations

import ctypes as c
from typing import TYPE_CHECKING, Any

from cyclonedds.builtin import (
    BuiltinDataReader,
    BuiltinTopicDcpsParticipant,
    BuiltinTopicDcpsPublication,
    BuiltinTopicDcpsSubscription,
)
from cyclonedds.core import InstanceState

from pieper.ros.bare import cyclone

if TYPE_CHECKING:
    from collections.abc import Iterator

    from cyclonedds.domain import DomainParticipant

ACQUAINTED = 5.0
"""Seconds after which a participant's writers and readers should be known; usually that takes a few milliseconds."""

_BATCH = 64


class _Info(c.Structure):
    """``dds_sample_info_t``."""

    _fields_ = (
        ("sample_state", c.c_uint32),
        ("view_state", c.c_uint32),
        ("instance_state", c.c_uint32),
        ("valid_data", c.c_bool),
        ("source_timestamp", c.c_int64),
        ("handles", c.c_uint64 * 2),
        ("counts", c.c_uint32 * 5),
    )


class _Participant(c.Structure):
    """``dds_builtintopic_participant_t``."""

    _fields_ = (("key", c.c_uint8 * 16), ("qos", c.c_void_p))


class _Endpoint(c.Structure):
    """The start of ``dds_builtintopic_endpoint_t``."""

    _fields_ = (("key", c.c_uint8 * 16), ("participant_key", c.c_uint8 * 16))


_take = cyclone._function("dds_take", c.c_int32, c.POINTER(c.c_void_p), c.POINTER(_Info), c.c_size_t, c.c_uint32)
_return_loan = cyclone._function("dds_return_loan", c.c_int32, c.POINTER(c.c_void_p), c.c_int32)


class Peers:
    """Follows who is there and what of them is known.

    Parameters
    ----------
    participant : cyclonedds.domain.DomainParticipant
        Its own domain is followed.
    """

    def __init__(self, participant: DomainParticipant) -> None:
        self._participants: Any = BuiltinDataReader(participant, BuiltinTopicDcpsParticipant)
        self._endpoints: dict[str, Any] = {
            "writers": BuiltinDataReader(participant, BuiltinTopicDcpsPublication),
            "readers": BuiltinDataReader(participant, BuiltinTopicDcpsSubscription),
        }
        self._owners: dict[bytes, tuple[bytes, str]] = {}
        self._known: dict[tuple[bytes, str], int] = {}
        self._there: set[bytes] = set()
        self._of_ros: set[bytes] = set()
        self._since: dict[bytes, float] = {}

    def strangers(self, now: float) -> list[bytes]:
        """Return the GUIDs of those of whom, for `ACQUAINTED` seconds, no endpoint is known; of ROS, not one of both kinds."""
        for address, alive in _taken(self._participants):
            peer = _Participant.from_address(address)
            guid = bytes(peer.key)
            if alive:
                self._there.add(guid)
                if cyclone.user_data(peer.qos).startswith(b"enclave="):
                    self._of_ros.add(guid)
            else:
                self._there.discard(guid)
                self._of_ros.discard(guid)
        for kind, reader in self._endpoints.items():
            for address, alive in _taken(reader):
                endpoint = _Endpoint.from_address(address)
                self._count(bytes(endpoint.key), (bytes(endpoint.participant_key), kind) if alive else None)
        self._since = {guid: self._since.get(guid, now) for guid in self._there if not self._is_known(guid)}
        return [guid for guid, since in self._since.items() if now - since > ACQUAINTED]

    def knows(self, guid: bytes) -> bool:
        """Whether a participant was there at the last look, and was no stranger."""
        return guid in self._there and guid not in self._since

    def _count(self, key: bytes, owner: tuple[bytes, str] | None) -> None:
        """Note who owns an endpoint; None if it is gone."""
        before = self._owners.pop(key, None)
        if before is not None:
            self._known[before] -= 1
            if not self._known[before]:
                del self._known[before]
        if owner is not None:
            self._owners[key] = owner
            self._known[owner] = self._known.get(owner, 0) + 1

    def _is_known(self, guid: bytes) -> bool:
        kinds = sum((guid, kind) in self._known for kind in self._endpoints)
        return kinds == len(self._endpoints) or (kinds > 0 and guid not in self._of_ros)


def _taken(reader: Any) -> Iterator[tuple[int, bool]]:
    """Take what is new: the address of a sample, which holds until the next one is asked for, and whether it tells of a life."""
    while True:
        samples, infos = (c.c_void_p * _BATCH)(), (_Info * _BATCH)()
        count = _take(reader._ref, samples, infos, _BATCH, _BATCH)
        if count <= 0:
            return
        try:
            for address, info in zip(samples[:count], infos[:count], strict=True):
                yield address or 0, bool(info.valid_data) and info.instance_state == InstanceState.Alive
        finally:
            _return_loan(reader._ref, samples, count)
