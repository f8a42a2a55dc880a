"""What the ROS graph learns of a node: its name and its endpoints, on the topic ``ros_discovery_info``.

DDS itself tells which readers and writers there are; which node they belong to, ROS 2 tells in this way
(``rmw_dds_common``). ``ros2 node list`` and ``ros2 node info`` read it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.ros import messages
from pieper.ros.bare.topic import TopicWriter
from pieper.ros.bare.type_support import describe
from pieper.ros.qos import LATCHED

if TYPE_CHECKING:
    from collections.abc import Iterable

    from pieper.ros.bare.participant import Participant

TYPE = "rmw_dds_common/msg/ParticipantEntitiesInfo"


class Discovery:
    """Tells of one node.

    Parameters
    ----------
    node, namespace : str
        ``"inverse"`` and ``"/cell2"``.

    Attributes
    ----------
    writer : TopicWriter
        Of ``ros_discovery_info``.
    """

    def __init__(self, node: str, namespace: str) -> None:
        self._node = node
        self._namespace = namespace
        self._participant = b""
        self.writer = self._new_writer()

    def open(self, participant: Participant) -> None:
        """Enter a participant."""
        self._participant = participant.guid
        self.writer = self._new_writer()
        self.writer.open(participant)

    def _new_writer(self) -> TopicWriter:  # a new one each time: what the last one told is not true any more
        return TopicWriter("ros_discovery_info", describe(TYPE), LATCHED, hash_told(TYPE))

    def tell(self, readers: Iterable[bytes], writers: Iterable[bytes]) -> None:
        """Tell of the node with these readers and writers, by their GUIDs."""
        node = {
            "node_namespace": self._namespace,
            "node_name": self._node,
            "reader_gid_seq": [_gid(guid) for guid in readers],
            "writer_gid_seq": [_gid(guid) for guid in writers],
        }
        message = messages.make(TYPE, gid=_gid(self._participant), node_entities_info_seq=[node])
        self.writer.write(messages.encode(TYPE, message))

    def leave(self) -> None:
        """Leave the participant."""
        self.writer.leave()


def hash_told(type_name: str) -> str:
    """Return the user data that tell other nodes the hash of a type."""
    return f"typehash={messages.type_hash(type_name)};"


def _gid(guid: bytes) -> dict[str, Any]:
    return {"data": np.frombuffer(guid, np.uint8)}
