"""Debian's Fast DDS as a foreign peer of the tests: compiled once, run as a process of its own on 127.0.0.1."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from pieper.ros import messages

if TYPE_CHECKING:
    from typing_extensions import Self

SOURCE = Path(__file__).with_name("fastdds_peer.cpp")
BUILDS = Path(__file__).parents[2] / "build" / "fastdds_peer"
COMPILER = os.environ.get("CXX", "g++")
COMMAND = (COMPILER, "-std=c++17", "-O0", str(SOURCE), "-lfastrtps", "-lfastcdr", "-o")
COMPILING = 300  # seconds; it takes three on a free processor
LATEST = 30  # seconds after which a peer ends by itself, whatever has happened


@cache
def peer_program() -> Path:
    """Compile the peer, unless this very source has been compiled before; skip the test where that cannot be done."""
    if shutil.which(COMPILER) is None:
        pytest.skip(f"no peer to talk to: there is no compiler {COMPILER}")
    key = hashlib.sha256(SOURCE.read_bytes() + " ".join(COMMAND).encode()).hexdigest()
    program = BUILDS / key[:16] / "fastdds_peer"
    if not program.exists():
        program.parent.mkdir(parents=True, exist_ok=True)
        unfinished = program.with_suffix(f".{os.getpid()}")
        run = subprocess.run([*COMMAND, str(unfinished)], capture_output=True, text=True, timeout=COMPILING)
        if run.returncode != 0 and "No such file or directory" in run.stderr:
            pytest.skip("no peer to talk to: Fast DDS 2 is not installed (apt-get install libfastrtps-dev)")
        assert run.returncode == 0, run.stderr
        unfinished.replace(program)
    return program


@dataclass(frozen=True)
class Received:
    """What the peer read: the fields as Fast CDR decoded them, and the bytes they came in."""

    message: dict[str, Any]
    payload: bytes


class Process:
    """One publisher or subscriber of Fast DDS. As a context manager it ends with the block at the latest."""

    def __init__(self, *words: object) -> None:
        self._process = subprocess.Popen(
            [peer_program(), *map(str, words), f"seconds={LATEST}"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._process.kill()
        self._process.communicate()

    def matched(self) -> None:
        """Wait until the peer knows the other side of its topic."""
        self._next("matched")

    def _write(self, words: list[str]) -> None:
        self._process.stdin.write(" ".join(words) + "\n")
        self._process.stdin.flush()

    def _next(self, key: str) -> dict[str, Any]:
        """The next line of output that has this key; the peer ends by itself, so this does, too."""
        for line in self._process.stdout:
            record = json.loads(line)
            if key in record:
                return record
        self._process.wait()
        raise AssertionError(f"the peer ended with {self._process.returncode}: {self._process.stderr.read()}")


class Publisher(Process):
    """A writer of one topic; it stays until the end of the block."""

    def __init__(self, domain: int, topic: str, type_name: str, *, latched: bool = False) -> None:
        super().__init__("publish", domain, topic, type_name, *["latched"] * latched)
        self.type_name = type_name

    def send(self, **fields: object) -> bytes:
        """Send one message, made from its fields as ours are, and return the bytes that Fast CDR made of it."""
        self._write(_words(messages.as_fields(messages.make(self.type_name, fields))))
        return bytes.fromhex(self._next("payload")["payload"])


class Subscriber(Process):
    """A reader of one topic, for `count` messages."""

    def __init__(self, domain: int, topic: str, type_name: str, *, count: int = 1, latched: bool = False) -> None:
        super().__init__("subscribe", domain, topic, type_name, f"count={count}", *["latched"] * latched)
        self._count = count

    def received(self) -> list[Received]:
        """Wait for all messages, and return them."""
        records = [self._next("payload") for _ in range(self._count)]
        return [Received(record["message"], bytes.fromhex(record["payload"])) for record in records]


class Encoder(Process):
    """Fast CDR without a network: messages of one type to bytes."""

    def __init__(self, type_name: str) -> None:
        super().__init__("encode", type_name)

    def encode(self, message: object) -> bytes:
        """Encode one of our messages."""
        self._write(_words(messages.as_fields(message)))
        return bytes.fromhex(self._next("payload")["payload"])


class Decoder(Process):
    """Fast CDR without a network: bytes to messages of one type."""

    def __init__(self, type_name: str) -> None:
        super().__init__("decode", type_name)

    def decode(self, payload: bytes) -> dict[str, Any]:
        """Decode what we encoded."""
        self._write([payload.hex()])
        return self._next("payload")["message"]


def _words(value: object) -> list[str]:
    """The values of a message in order, as the peer reads them."""
    if isinstance(value, dict):
        return [word for item in value.values() for word in _words(item)]
    if isinstance(value, list):
        return [str(len(value)), *(word for item in value for word in _words(item))]
    if isinstance(value, str):
        return ['"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"']
    return [repr(value)]
