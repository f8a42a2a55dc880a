"""Processes that leave Ctrl-C to the one that began them, from their first moment.

A terminal sends Ctrl-C to every process of a group. One that is still importing would answer it with a traceback; so the signal is held back while
a process is made, which it inherits, and thrown away once it can say that it does not want it.
"""

from __future__ import annotations

import signal
from multiprocessing.context import SpawnContext, SpawnProcess

_HELD = {signal.SIGINT}


class _QuietProcess(SpawnProcess):
    def start(self) -> None:
        """As of any process, with Ctrl-C held back meanwhile."""
        if not hasattr(signal, "pthread_sigmask"):  # Windows
            super().start()
            return
        from multiprocessing import resource_tracker

        resource_tracker.ensure_running()  # which would let the signal through again
        before = signal.pthread_sigmask(signal.SIG_BLOCK, _HELD)
        try:
            super().start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


class QuietContext(SpawnContext):
    """The context ``"spawn"`` of multiprocessing, with processes that leave Ctrl-C alone; they begin with `leave_ctrl_c_alone`."""

    Process = _QuietProcess


def leave_ctrl_c_alone() -> None:
    """Throw away what was held back, and whatever comes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _HELD)
