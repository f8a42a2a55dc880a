"""What a node says about bad input: at once, and then no more than once a second."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pieper.ros.bus import Bus


class Complaints:
    """Lines of log that may come as often as the messages that they are about.

    Parameters
    ----------
    bus : Bus
        Where they go.
    period : float
        Seconds between two lines that say the same.

    Examples
    --------
    >>> from pieper.ros.fake import FakeNetwork
    >>> network = FakeNetwork()
    >>> bus = network.bus("arm")
    >>> complaints = Complaints(bus)
    >>> for _ in range(500):
    ...     complaints.say("warn", "no number: nan")
    ...     network.advance(0.01)
    >>> bus.lines[0], bus.lines[1], len(bus.lines)
    ('no number: nan', 'no number: nan (and 99 more like it)', 5)
    """

    def __init__(self, bus: Bus, *, period: float = 1.0) -> None:
        self._bus, self._period = bus, round(period * 1e9)
        self._said: dict[str, tuple[int, int]] = {}  # when, and how many were kept back since

    def say(self, level: str, text: str) -> None:
        """Say it, unless a line with the same words before its first colon was said within the last period."""
        kind = text.partition(":")[0]
        now = self._bus.now()
        when, kept_back = self._said.get(kind, (-self._period, 0))
        if 0 <= now - when < self._period:
            self._said[kind] = when, kept_back + 1
            return
        self._said[kind] = now, 0
        self._bus.log(level, f"{text} (and {kept_back} more like it)" if kept_back else text)
