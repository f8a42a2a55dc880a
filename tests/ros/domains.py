"""DDS domains for tests: those of this process, which no other test process on the machine uses at the same time."""

from __future__ import annotations

import itertools
import socket
from functools import cache

SIZE = 7  # domains to a process, taken in turn, so that what a dead process of the last test left is not heard
BLOCKS = 30
FIRST = 2  # 0 is everybody's; the last ones, from 212 on, are for the tests of a hostile network
_turn = itertools.count()


def new_domain() -> int:
    """A domain that no test beside this one uses."""
    return FIRST + _reserve()[1] * SIZE + next(_turn) % SIZE


@cache
def _reserve() -> tuple[socket.socket, int]:
    """A block of domains, and what reserves it for as long as this process lives: a port that only one can have."""
    for block in range(BLOCKS):
        try:
            lock = socket.create_server(("127.0.0.1", 27400 + block), reuse_port=False)
        except OSError:
            continue
        return lock, block
    raise RuntimeError(f"{BLOCKS} test processes have reserved all DDS domains")
