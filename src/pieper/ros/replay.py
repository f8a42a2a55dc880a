"""A bag, said again on a bus, as far apart in time as it was recorded."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pieper.errors import RosError
from pieper.ros.bag import SHORTEST_ROUND, Bag, Message

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path
    from types import TracebackType

    from typing_extensions import Self

    from pieper.ros.bus import Bus, Publisher

_MOST_AT_ONCE = 200  # messages sent in one go, so that a signal is seen between them


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
        self._began += round(max(SHORTEST_ROUND * 1e9, (span + span / max(1, self._bag.count - 1)) / self._rate))
        self._messages = self._bag.messages(self._topics)
        self._next = next(self._messages, None)

    def _finish(self) -> None:
        self.done = True
        if self._bag.undecodable:
            self._bus.log("warn", f"{self._bag.path}: {self._bag.undecodable} damaged messages were left out")
