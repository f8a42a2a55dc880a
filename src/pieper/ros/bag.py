"""A bag to read: a folder of ROS 2, a single file of either storage, or a ROS 1 bag, whose messages become ROS 2 messages field by field.

References
----------
ROS 1 wiki, "Bags/Format/2.0".
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from pieper.errors import MissingExtraError, RosError, unknown_name
from pieper.ros import messages
from pieper.ros.qos import DEFAULT, LATCHED, QoS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from types import TracebackType

    from typing_extensions import Self


_ROS_1_NAMES = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage", "rosgraph_msgs/msg/Log": "rcl_interfaces/msg/Log"}
SHORTEST_ROUND = 0.01  # seconds that one round of a loop takes at least


class Message(NamedTuple):
    """One message of a bag.

    Attributes
    ----------
    topic, type : str
        Where it was sent, and its type; that of ROS 2 for a ROS 1 bag.
    time : int
        Nanoseconds since 1970 at which it was recorded.
    message : object
        With its fields as attributes.
    """

    topic: str
    type: str
    time: int
    message: Any


@dataclass(frozen=True)
class BagTopic:
    """A topic in a bag.

    Attributes
    ----------
    type : str
        Its type; that of ROS 2 for a ROS 1 bag.
    count : int
        Number of messages.
    qos : QoS
        With which it was published, as far as the bag tells.
    problem : str
        Why its messages cannot be read; empty if they can.
    """

    type: str
    count: int
    qos: QoS
    problem: str = ""


class Bag:
    """A bag, open for reading. Use it as a context manager, or :meth:`close` it.

    Parameters
    ----------
    path : path
        A folder of ROS 2, one ``.mcap`` or ``.db3`` file, or a ``.bag`` file of ROS 1.

    Attributes
    ----------
    topics : dict of BagTopic
        By name.
    undecodable : int
        Messages that were left out because their bytes did not fit their type.

    Raises
    ------
    RosError
        It is not there, not a bag, or damaged.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.undecodable = 0
        self._is_ros_1 = self.path.suffix == ".bag" and not self.path.is_dir()
        reader = rosbags_module("rosbag1" if self._is_ros_1 else "rosbag2").Reader
        if not self.path.exists():
            raise RosError(f"there is no bag at {self.path}")
        try:
            self._reader = reader(self.path)
            self._reader.open()
        except Exception as error:
            raise RosError(
                f"{self.path} is not a bag (a folder with metadata.yaml, or an .mcap, .db3 or .bag file): {error}"
            ) from error
        self._decoders: dict[int, Callable[[bytes], Any]] = {}
        self.topics: dict[str, BagTopic] = {}
        for connection in self._reader.connections:
            self._look_at(connection)

    @property
    def count(self) -> int:
        """Number of messages."""
        return sum(topic.count for topic in self.topics.values())

    @property
    def duration(self) -> float:
        """Seconds between the first message and the last; 0 for an empty bag."""
        return float(self._reader.duration) * 1e-9 if self.count else 0.0

    def messages(self, topics: Sequence[str] = ()) -> Iterator[Message]:
        """Messages in the order in which they were recorded.

        Parameters
        ----------
        topics : sequence of str
            Only these; otherwise all that can be read.

        Returns
        -------
        iterator of Message
            With topic, time [ns] and the message itself.

        Raises
        ------
        RosError
            One of these cannot be read, or the bag is damaged.
        UnknownNameError
            One of these is not in the bag.
        """
        for name in topics:
            if name not in self.topics:
                raise unknown_name("topic", name, self.topics, str(self.path))
            if self.topics[name].problem:
                raise RosError(f"{self.path}: topic {name}: {self.topics[name].problem}")
        connections = [
            c for c in self._reader.connections if c.id in self._decoders and (c.topic in topics or not topics)
        ]
        return self._read(connections) if connections else iter(())  # the reader would take none for all

    def _read(self, connections: list[Any]) -> Iterator[Message]:
        try:
            for connection, time, data in self._reader.messages(connections=connections):
                try:
                    message = self._decoders[connection.id](bytes(data))
                except Exception:  # noqa: BLE001  whatever hostile bytes do to a decoder, this is what it means
                    self.undecodable += 1
                    continue
                yield Message(connection.topic, _ros_2_name(connection.msgtype), int(time), message)
        except Exception as error:
            raise RosError(f"{self.path} is damaged: {error}") from error

    def close(self) -> None:
        """Close the files."""
        self._reader.close()

    def __enter__(self) -> Self:
        """Return the bag itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the files."""
        self.close()

    def _look_at(self, connection: Any) -> None:
        """Add a connection to the topics, and find out how to read its messages."""
        name, type_name = connection.topic, _ros_2_name(connection.msgtype)
        problem = ""
        before = self.topics.get(name)
        if before is not None and before.type != type_name:
            problem = f"two types under one name: {before.type} and {type_name}"
        else:
            try:
                self._decoders[connection.id] = self._decoder(connection, type_name)
            except Exception as error:  # noqa: BLE001  definitions in a bag are as hostile as messages
                problem = str(error)
        count = int(self._reader.topics[name].msgcount) if before is None else before.count
        qos = DEFAULT if before is None else before.qos
        self.topics[name] = BagTopic(type_name, count, _from_bag_qos(connection.ext) or qos, problem)

    def _decoder(self, connection: Any, type_name: str) -> Callable[[bytes], Any]:
        """What turns bytes of this connection into a message of ours."""
        ours = messages.typestore(type_name)
        theirs = _definitions(connection)
        if not self._is_ros_1 and (theirs is None or _is_same(theirs, ours, type_name)):
            return partial(messages.decode, type_name)
        if theirs is None:
            raise RosError("the bag does not say what its messages are made of")
        from rosbags.convert.converter import migrate_message

        read = theirs.deserialize_ros1 if self._is_ros_1 else theirs.deserialize_cdr
        cache: dict[str, object] = {}

        def decode(data: bytes) -> Any:
            message = read(data, connection.msgtype)
            return migrate_message(theirs, ours, connection.msgtype, type_name, cache, message)

        return decode


def _ros_2_name(type_name: str) -> str:
    return _ROS_1_NAMES.get(type_name, type_name)


def _definitions(connection: Any) -> Any:
    """Types that a bag brings for a connection, as a store; None if it brings none."""
    typesys, interfaces = rosbags_module("typesys"), rosbags_module("interfaces")
    formats, definition = interfaces.MessageDefinitionFormat, connection.msgdef
    if definition.format == formats.NONE or not definition.data.strip():
        return None
    types: dict[str, Any] = {}
    if definition.format == formats.MSG:
        types = typesys.get_types_from_msg(definition.data, connection.msgtype)
    else:
        rule = "=" * 80 + "\n"  # before each part of a definition that has several
        for part in definition.data.split(rule):
            types |= (
                typesys.get_types_from_idl(part.partition("\n")[2] if part.startswith("IDL: ") else part)
                if part
                else {}
            )
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    store.register(types)
    return store


def _is_same(theirs: Any, ours: Any, type_name: str) -> bool:
    """Whether two stores mean the same by a type, down to the last field."""
    node = rosbags_module("interfaces").Nodetype
    left, right = theirs.fielddefs[type_name][1], ours.fielddefs[type_name][1]
    if len(left) != len(right):
        return False
    for (name, desc), (our_name, our_desc) in zip(left, right, strict=True):
        inner, our_inner = (d[1][0] if d[0] in (node.ARRAY, node.SEQUENCE) else d for d in (desc, our_desc))
        if name != our_name or desc[0] != our_desc[0] or _without_char(desc) != our_desc:
            return False
        if inner[0] == node.NAME and not _is_same(theirs, ours, our_inner[1]):
            return False
    return True


def _without_char(desc: Any) -> Any:
    if desc == "char":
        return "uint8"
    return type(desc)(_without_char(part) for part in desc) if type(desc) is tuple else desc


def _from_bag_qos(extension: Any) -> QoS | None:
    """What a bag tells about the quality of service; None if nothing."""
    if getattr(extension, "latching", None):
        return LATCHED
    i = rosbags_module("interfaces")
    for profile in getattr(extension, "offered_qos_profiles", ()):
        latched = profile.durability == i.QosDurability.TRANSIENT_LOCAL
        depth = profile.depth if 0 < profile.depth <= 1000 else DEFAULT.depth
        return QoS(reliable=profile.reliability != i.QosReliability.BEST_EFFORT, transient_local=latched, depth=depth)
    return None


def rosbags_module(module: str) -> Any:
    """A module of rosbags, which the extra ``ros`` brings."""
    from importlib import import_module

    try:
        return import_module(f"rosbags.{module}")
    except ImportError as error:
        raise MissingExtraError("rosbags", "ros", "reading and writing bags") from error
