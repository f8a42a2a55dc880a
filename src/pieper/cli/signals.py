"""What a command does when it is asked to end, for as long as it works."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager


@contextmanager
def handled(numbers: Iterable[int], handler: Callable[..., object]) -> Iterator[None]:
    """Have `handler` called for these signals; afterwards they do what they did before."""
    before = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)


@contextmanager
def stopped_once(stop: Callable[[], object]) -> Iterator[list[int]]:
    """Ctrl-C, or an order to end, calls `stop`; a second one ends at once. Gives the signals that came."""
    came: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield came
        return

    def asked(number: int, _: object) -> None:
        if came:
            raise KeyboardInterrupt
        came.append(number)
        stop()

    with handled((signal.SIGINT, signal.SIGTERM), asked):
        yield came
