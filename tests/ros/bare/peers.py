"""Other processes on the same network, and this one's wires."""

from __future__ import annotations

import subprocess
import sys
import time
from contextlib import contextmanager

from pieper.ros import messages


def until(condition, *wires, seconds: float = 10.0) -> bool:
    """Let the wires work until the condition holds."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            return False
        for wire in wires:
            wire.wait(0.002)
        if not wires:
            time.sleep(0.002)
    return True


def cdr(type_name: str, **fields) -> bytes:
    return messages.encode(type_name, messages.make(type_name, **fields))


@contextmanager
def process(script: str, *arguments: object):
    """A Python process that runs a script; it is gone in the end, however the test ends."""
    command = [sys.executable, "-c", script, *map(str, arguments)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as child:
        try:
            yield child
        finally:
            child.kill()


def endpoints(domain: int, what: str):
    """What DDS itself tells of the ``Publication``s or ``Subscription``s of a domain that this process has open."""
    from cyclonedds import builtin
    from cyclonedds.domain import DomainParticipant

    participant = DomainParticipant(domain)
    return builtin.BuiltinDataReader(participant, getattr(builtin, f"BuiltinTopicDcps{what}")).take(1000)


def written(domain: int) -> dict[str, str]:
    """Names and types of the topics that are written in a domain."""
    return {found.topic_name: found.type_name for found in endpoints(domain, "Publication")}
