"""What the tracker finds, handed to whoever wants it while it runs: a window, a robot's controller, a ROS node."""

from __future__ import annotations

import threading
import warnings
from collections import deque
from typing import TYPE_CHECKING, Generic, TypeVar

from pieper.errors import PieperWarning

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

T = TypeVar("T")


class Stream(Generic[T]):
    """Values, usually a `Step` for each frame, from one who publishes to any number who listen.

    Examples
    --------
    >>> stream = Stream()
    >>> heard = []
    >>> leave = stream.subscribe(heard.append)
    >>> stream.publish("a")
    >>> leave()
    >>> stream.publish("b")
    >>> heard
    ['a']
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._listeners: dict[int, Callable[[T], object]] = {}
        self._number = 0
        self._waiting: list[_Listener[T]] = []
        self._closed = False

    def subscribe(self, callback: Callable[[T], object]) -> Callable[[], None]:
        """Have a function called with every value from now on, in the thread of the publisher; it should be quick.

        One that raises is not called again, and a `PieperWarning` says so: a listener does not stop the tracker.

        Returns
        -------
        callable
            Call it to hear no more.
        """
        with self._lock:
            self._number += 1
            number = self._number
            self._listeners[number] = callback

        def leave() -> None:
            with self._lock:
                self._listeners.pop(number, None)

        return leave

    def publish(self, value: T) -> None:
        """Give a value to everybody who listens."""
        with self._lock:
            listeners = list(self._listeners.items())
        for number, callback in listeners:
            self._tell(number, callback, value)

    def _tell(self, number: int, callback: Callable[[T], object], value: T) -> None:
        try:
            callback(value)
        except Exception as error:  # noqa: BLE001  of somebody else's function
            with self._lock:
                self._listeners.pop(number, None)
            what = f"{type(error).__name__}: {error}"
            warnings.warn(f"a listener of the stream failed and hears no more: {what}", PieperWarning, stacklevel=3)

    def listen(self, *, queue: int = 1) -> Iterator[T]:
        """Give the values from now on, to be iterated in another thread, until the stream is closed.

        Who is slow misses the oldest: at most `queue` values wait.
        """
        listener = _Listener[T](queue)
        with self._lock:
            self._waiting.append(listener)
            if self._closed:
                listener.end()
        leave = self.subscribe(listener.put)

        def forget() -> None:
            leave()
            with self._lock:
                if listener in self._waiting:
                    self._waiting.remove(listener)

        return listener.values(forget)

    def close(self) -> None:
        """Say that there will be no more values."""
        with self._lock:
            self._closed = True
            waiting = list(self._waiting)
            self._waiting.clear()
        for listener in waiting:
            listener.end()


class _Listener(Generic[T]):
    def __init__(self, queue: int) -> None:
        self._values: deque[T] = deque(maxlen=max(1, queue))
        self._change = threading.Condition()
        self._ended = False

    def put(self, value: T) -> None:
        with self._change:
            self._values.append(value)
            self._change.notify()

    def end(self) -> None:
        with self._change:
            self._ended = True
            self._change.notify()

    def values(self, leave: Callable[[], None]) -> Iterator[T]:
        try:
            while True:
                with self._change:
                    while not self._values and not self._ended:
                        self._change.wait(0.2)
                    if not self._values:
                        return
                    value = self._values.popleft()
                yield value
        finally:
            leave()
