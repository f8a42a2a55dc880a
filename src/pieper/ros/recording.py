"""Topics of a bus, recorded into a bag that ``ros2 bag`` reads, with MCAP or SQLite storage.

A recording appears under its name when it is whole: until then it grows in a hidden folder beside it.

References
----------
rosbag2, "Bag metadata" version 8, which Humble and Jazzy read alike.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pieper.errors import RosError, unknown_name
from pieper.ros import messages
from pieper.ros.bag import rosbags_module

if TYPE_CHECKING:
    from collections.abc import Iterable

    from pieper.ros.bus import Bus, Subscription
    from pieper.ros.qos import QoS
    from pieper.ros.topics import Topic

STORAGES = ("mcap", "sqlite3")
_METADATA_VERSION = 8


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
    rosbag2 = rosbags_module("rosbag2")
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


def _as_bag_qos(qos: QoS) -> Any:
    i = rosbags_module("interfaces")
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
