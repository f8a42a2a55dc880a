"""Bags: what was said on some topics, kept in a file, and said again.

Written are folders that ``ros2 bag`` reads (MCAP or SQLite storage); read are these, single files of either storage, and
ROS 1 bags, whose messages become ROS 2 messages field by field.

A recording appears under its name when it is whole: until then it grows in a hidden folder beside it.

References
----------
rosbag2, "Bag metadata" version 8, which Humble and Jazzy read alike; ROS 1 wiki, "Bags/Format/2.0".
"""

from __future__ import annotations

import shutil
import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from pieper.errors import MissingExtraError, RosError, unknown_name
from pieper.ros import messages
from pieper.ros.qos import DEFAULT, LATCHED, QoS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from types import TracebackType

    from typing_extensions import Self

    from pieper.ros.bus import Bus, Publisher, Subscription
    from pieper.ros.topics import Topic

STORAGES = ("mcap", "sqlite3")

_METADATA_VERSION = 8
_ROS_1_NAMES = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage", "rosgraph_msgs/msg/Log": "rcl_interfaces/msg/Log"}
_MOST_AT_ONCE = 200  # messages sent in one go, so that a signal is seen between them
_SHORTEST_ROUND = 0.01  # seconds that one round of a loop takes at least


# Recording


def record(
    bus: Bus, topics: Iterable[Topic], path: str | Path, *, storage: str = "mcap", seconds: float | None = None
) -> dict[str, int]:
    """Record topics until the time is over or the bus is stopped.

    Parameters
    ----------
    bus : Bus
        Spun by this function. :meth:`Bus.stop <pieper.ros.bus.Bus.stop>`, from a signal handler for example, ends the
        recording, and what was recorded is kept.
    topics : iterable of Topic
        What to record.
    path : path
        Folder to write; it must not exist.
    storage : str
        ``"mcap"`` or ``"sqlite3"``.
    seconds : float, optional
        How long; until the bus is stopped if not given.

    Returns
    -------
    dict
        Number of messages of each topic.

    Raises
    ------
    RosError
        The folder exists or cannot be written, a name or type is not known, the time is not positive, or no message came.
    """
    if seconds is not None and not 0.0 < seconds < float("inf"):
        raise RosError(f"the seconds of a recording must be positive and finite, got {seconds}")
    recorder = Recorder(bus, topics, path, storage=storage)
    try:
        bus.spin_until(lambda: recorder.failure is not None, timeout=seconds)
    except KeyboardInterrupt:
        pass  # the usual way to end a recording
    except BaseException:
        recorder.abandon()
        raise
    return recorder.close()


class Recorder:
    """Writes what comes on some topics into a new bag, while others spin the bus.

    Parameters are those of :func:`record`.

    Attributes
    ----------
    counts : dict
        Number of messages of each topic so far.
    failure : Exception, optional
        What ended the writing early, for example a full disk.
    """

    def __init__(self, bus: Bus, topics: Iterable[Topic], path: str | Path, *, storage: str = "mcap") -> None:
        chosen = list(topics)
        if not chosen:
            raise RosError("name at least one topic to record")
        self.path = Path(path)
        self.counts: dict[str, int] = {}
        self.failure: Exception | None = None
        self._bus = bus
        self._workplace, self._writer = _new_bag(self.path, storage)
        self._subscriptions: list[Subscription] = []
        try:
            for topic in chosen:
                self._add(topic)
        except BaseException:
            self.abandon()
            raise

    def close(self) -> dict[str, int]:
        """Finish the bag and give it its name; return the counts.

        Raises
        ------
        RosError
            Nothing came, or the bag could not be written.
        """
        if not any(self.counts.values()) or self.failure is not None:
            self.abandon()
            if self.failure is not None:
                raise RosError(f"{self.path} could not be written: {self.failure}") from self.failure
            raise RosError(f"nothing was recorded: no message came on {', '.join(self.counts)}")
        self._leave()
        try:
            self._writer.close()
            self.path.parent.mkdir(parents=True, exist_ok=True)
            (self._workplace / self.path.name).rename(self.path)
        except Exception as error:
            raise RosError(
                f"{self.path} could not be finished: {error}; what there is lies in {self._workplace}"
            ) from error
        self._workplace.rmdir()
        return self.counts

    def abandon(self) -> None:
        """Forget the bag; nothing is left of it."""
        self._leave()
        self._writer.abort()
        shutil.rmtree(self._workplace, ignore_errors=True)

    def _leave(self) -> None:
        while self._subscriptions:
            self._subscriptions.pop().close()

    def _add(self, topic: Topic) -> None:
        subscription = self._bus.subscribe(
            topic.name, topic.type, lambda message: self._write(connection, message), qos=topic.qos
        )
        self._subscriptions.append(subscription)
        name = subscription.topic
        if name in self.counts:
            raise RosError(f"topic {name} is named twice")
        self.counts[name] = 0
        connection = self._writer.add_connection(
            name,
            topic.type,
            msgdef=messages.typestore(topic.type).generate_msgdef(topic.type, ros_version=2)[0],
            rihs01=messages.type_hash(topic.type),
            offered_qos_profiles=[_as_bag_qos(topic.qos)],
        )

    def _write(self, connection: Any, message: Any) -> None:
        if self.failure is not None:
            return
        try:
            self._writer.write(connection, self._bus.now(), messages.encode(connection.msgtype, message))
            self.counts[connection.topic] += 1
        except Exception as error:  # noqa: BLE001  a full disk has as many faces as there are storages
            self.failure = error


def _new_bag(path: Path, storage: str) -> tuple[Path, Any]:
    """A hidden folder beside the path, and the writer of a bag inside."""
    rosbag2 = _rosbags("rosbag2")
    if storage not in STORAGES:
        raise unknown_name("storage", storage, STORAGES)
    if path.exists() or path.is_symlink():
        raise RosError(f"{path} exists already, and a recording never overwrites; choose another name or remove it")
    if not path.name:
        raise RosError(f"{str(path)!r} is not the name of a folder to write")
    if storage == "sqlite3" and set(str(path.absolute())) & set("?#%"):
        raise RosError(f"{path}: SQLite cannot write below a name with '?', '#' or '%'; take the storage mcap")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        workplace = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    except OSError as error:
        raise RosError(f"{path} cannot be written: {error.strerror or error}") from error
    plugin = getattr(rosbag2.StoragePlugin, storage.upper())
    writer = rosbag2.Writer(workplace / path.name, version=_METADATA_VERSION, storage_plugin=plugin)
    try:
        writer.open()
    except Exception as error:  # a full disk has as many faces as there are storages
        shutil.rmtree(workplace, ignore_errors=True)
        raise RosError(f"{path} cannot be written: {error}") from error
    return workplace, writer


# Reading


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
        reader = _rosbags("rosbag1" if self._is_ros_1 else "rosbag2").Reader
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
    typesys, interfaces = _rosbags("typesys"), _rosbags("interfaces")
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
    node = _rosbags("interfaces").Nodetype
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


def _as_bag_qos(qos: QoS) -> Any:
    i = _rosbags("interfaces")
    forever, lifespan = i.QosTime(2147483647, 4294967295), divmod(round(min(qos.lifespan, 1e9) * 1e9), 10**9)
    return i.Qos(
        i.QosHistory.KEEP_LAST,
        qos.depth,
        i.QosReliability.RELIABLE if qos.reliable else i.QosReliability.BEST_EFFORT,
        i.QosDurability.TRANSIENT_LOCAL if qos.transient_local else i.QosDurability.VOLATILE,
        forever,
        forever if qos.lifespan == float("inf") else i.QosTime(*lifespan),
        i.QosLiveliness.AUTOMATIC,
        forever,
        avoid_ros_namespace_conventions=False,
    )


def _from_bag_qos(extension: Any) -> QoS | None:
    """What a bag tells about the quality of service; None if nothing."""
    if getattr(extension, "latching", None):
        return LATCHED
    i = _rosbags("interfaces")
    for profile in getattr(extension, "offered_qos_profiles", ()):
        latched = profile.durability == i.QosDurability.TRANSIENT_LOCAL
        depth = profile.depth if 0 < profile.depth <= 1000 else DEFAULT.depth
        return QoS(reliable=profile.reliability != i.QosReliability.BEST_EFFORT, transient_local=latched, depth=depth)
    return None


def _rosbags(module: str) -> Any:
    from importlib import import_module

    try:
        return import_module(f"rosbags.{module}")
    except ImportError as error:
        raise MissingExtraError("rosbags", "ros", "reading and writing bags") from error


# Replaying


def replay(
    bus: Bus,
    path: str | Path,
    *,
    rate: float = 1.0,
    topics: Sequence[str] = (),
    loop: bool = False,
    delay: float = 0.0,
) -> int:
    """Send the messages of a bag again, as far apart in time as they were recorded.

    Parameters
    ----------
    bus : Bus
        Spun by this function until the bag is over or the bus is stopped. Names in the bag are remapped like any other.
    path : path
        As for :class:`Bag`.
    rate : float
        How many times as fast.
    topics : sequence of str
        Only these; otherwise all.
    loop : bool
        Begin again at the end.
    delay : float
        Seconds to wait before the first message, so that subscribers have found the publishers.

    Returns
    -------
    int
        Number of messages sent.

    Raises
    ------
    RosError
        It is not a bag, it is empty, or none of its messages can be read.
    UnknownNameError
        One of ``topics`` is not in the bag.
    """
    with Replay(bus, path, rate=rate, topics=topics, loop=loop, delay=delay) as player:
        bus.spin_until(lambda: player.done)
        if player.failure is not None:
            raise player.failure
        return player.sent


class Replay:
    """Sends the messages of a bag while others spin the bus.

    Parameters are those of :func:`replay`.

    Attributes
    ----------
    sent : int
        Number of messages sent so far.
    done : bool
        Whether the bag is over.
    failure : Exception, optional
        What ended it early, for example a damaged bag.
    """

    def __init__(
        self,
        bus: Bus,
        path: str | Path,
        *,
        rate: float = 1.0,
        topics: Sequence[str] = (),
        loop: bool = False,
        delay: float = 0.0,
    ) -> None:
        if not 0.0 < rate < float("inf"):
            raise RosError(f"the rate of a replay must be positive and finite, got {rate!r}")
        if not 0.0 <= delay < float("inf"):
            raise RosError(f"the delay of a replay must be some seconds, got {delay!r}")
        self.sent, self.done = 0, False
        self.failure: Exception | None = None
        self._bus, self._rate, self._loop = bus, rate, loop
        self._bag = Bag(path)
        try:
            self._topics = list(topics) or self._readable()
            self._messages = self._bag.messages(self._topics)
            self._publishers = {name: self._publisher(name) for name in self._topics}
            first = next(self._messages, None)
            if first is None:
                raise RosError(f"{self._bag.path}: none of its messages can be read")
        except BaseException:
            self._bag.close()
            raise
        self._next: Message | None = first
        self._first = self._last = first.time
        self._began = bus.now() + round(delay * 1e9)
        self._wait(max(delay, 1e-6))

    def close(self) -> None:
        """Send no more."""
        self.done = True
        self._timer.cancel()
        self._bag.close()

    def __enter__(self) -> Self:
        """Return the replay itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Send no more."""
        self.close()

    def _readable(self) -> list[str]:
        bag = self._bag
        if not bag.count:
            raise RosError(f"{bag.path} is empty")
        for name, topic in bag.topics.items():
            if topic.problem:
                self._bus.log("warn", f"{bag.path}: topic {name} is left out: {topic.problem}")
        readable = [name for name, topic in bag.topics.items() if not topic.problem]
        if not readable:
            raise RosError(f"{bag.path}: none of its topics can be read")
        return readable

    def _publisher(self, name: str) -> Publisher:
        topic = self._bag.topics[name]
        return self._bus.publisher(name, topic.type, qos=topic.qos)

    def _wait(self, seconds: float) -> None:
        self._timer = self._bus.timer(max(seconds, 1e-6), self._work)

    def _work(self) -> None:
        self._timer.cancel()
        try:
            wait = self._send_what_is_due()
        except Exception as error:  # noqa: BLE001  replay() raises it where the user called
            self.failure, self.done = error, True
            return
        if wait is None:
            self._finish()
        else:
            self._wait(wait)

    def _send_what_is_due(self) -> float | None:
        """Seconds until there is more to do; None when the bag is over."""
        for _ in range(_MOST_AT_ONCE):
            if self._next is None and self._loop:
                self._begin_again()
            if self._next is None:
                return None
            due = self._began + round((self._next.time - self._first) / self._rate)
            now = self._bus.now()
            if due > now:
                return (due - now) * 1e-9
            self._publishers[self._next.topic].send(self._next.message)
            self.sent += 1
            self._last = max(self._last, self._next.time)
            self._next = next(self._messages, None)
        return 0.0

    def _begin_again(self) -> None:
        """Start the next round of a loop, the usual time between two messages after the last one."""
        span = self._last - self._first
        self._began += round(max(_SHORTEST_ROUND * 1e9, (span + span / max(1, self._bag.count - 1)) / self._rate))
        self._messages = self._bag.messages(self._topics)
        self._next = next(self._messages, None)

    def _finish(self) -> None:
        self.done = True
        if self._bag.undecodable:
            self._bus.log("warn", f"{self._bag.path}: {self._bag.undecodable} damaged messages were left out")
