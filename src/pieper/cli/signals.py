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
def ended_by_a_signal() -> Iterator[None]:
    """An order to end is taken as Ctrl-C is, so that half-written files are cleared away; one that is ignored stays so."""
    here = threading.current_thread() is threading.main_thread()
    if not here or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return
    with handled((signal.SIGTERM,), _interrupt):
        yield


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt


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
