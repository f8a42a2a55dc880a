"""Attack a node on bare DDS over the loopback interface: malformed samples, mutated datagrams, lies, giants, crowds.

    python fuzz/fuzz_ros.py -max_total_time=600 [-seed=1] [-rounds=1000000]

The node is a process of its own; another node talks to it all the while. Rounds of all attacks, drawn from the seed, until the time
or the rounds are over. After each attack the node has to live, to hear good messages on a reliable and on a best-effort
topic, at once or after saying that it was deaf, and not to have grown by more than `MEMORY`; the table at the end tells
how it went. Nobody reads the standard error of the node. 127.0.0.1 only.
"""

from __future__ import annotations

import argparse
import os
import random
import struct
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from pieper.errors import RosError
from pieper.ros import messages
from tests.ros import rtps
from tests.ros.hostile import ROOT, Talker, Victim

MEMORY = 200.0
"""MiB that the node may grow by, in all: it may hold a sample of 64 MiB, its bytes and its text."""

SOON = 90.0
"""Seconds in which a node has to hear again: the longest pause of the watchdog between two alarms, and the recovery."""

DECODED = (
    "std_msgs/msg/String",
    "sensor_msgs/msg/JointState",
    "sensor_msgs/msg/Image",
    "trajectory_msgs/msg/JointTrajectory",
)


@dataclass
class Record:
    """What came out of one kind of attack."""

    rounds: int = 0
    sent: int = 0
    refused: int = 0
    deaf: int = 0
    slowest: float = 0.0
    grown: float = 0.0
    notes: Counter[str] = field(default_factory=Counter)


class Attacker:
    """The attacks; each returns how many messages it sent and how many of them the sender's own DDS refused."""

    def __init__(self, draw: random.Random, victim: Victim, talker: Talker) -> None:
        self.draw, self.victim, self.talker = draw, victim, talker

    def names(self) -> tuple[bytes, bytes, list[tuple[bytes, bytes]]]:
        """The talker's and the victim's prefix as they are now, and the talker's writers with its builtin ones."""
        guids = [self.talker.guid(p) for p in (self.talker.reliable, self.talker.sensor, self.talker.joints)]
        writers = [(g[12:], g[:12]) for g in guids]
        return guids[0][:12], bytes.fromhex(self.victim.state["prefix"]), writers

    def pause(self, k: int) -> None:
        """Let the talker talk, and the victim's kernel queue drain."""
        if k % 40 == 0:
            self.talker.bus.spin_once(0.002)

    def malformed_samples(self) -> tuple[int, int]:
        """Payloads with a few bytes, counts or lengths wrong, or cut short, through a real writer."""
        good = (
            messages.encode("std_msgs/msg/String", messages.make("std_msgs/msg/String", data="good or not")),
            messages.encode(
                "sensor_msgs/msg/JointState",
                messages.make("sensor_msgs/msg/JointState", name=["a", "b"], position=[0.1, 0.2]),
            ),
            messages.encode(
                "sensor_msgs/msg/Image",
                messages.make("sensor_msgs/msg/Image", encoding="mono8", width=8, height=8, step=8, data=[7] * 64),
            ),
        )
        sent, refused = 500, 0
        for k in range(sent):
            which = self.draw.randrange(3)
            raw = rtps.mutated(self.draw, [b"\0" * 20 + good[which]])[20:]
            try:
                (self.talker.reliable, self.talker.joints, self.talker.image)[which]._writer.write(raw)
            except RosError:
                refused += 1
            self.pause(k)
        return sent, refused

    def mutated_datagrams(self) -> tuple[int, int]:
        """Messages of every kind in the talker's name, with bytes, numbers or pieces wrong."""
        talker, victim, writers = self.names()
        seeds = [t for writer, _ in writers for t in rtps.templates(talker, victim, writer)]
        for k in range(1000):
            self.victim.send(rtps.mutated(self.draw, seeds))
            self.pause(k)
        return 2000, 0

    def noise(self) -> tuple[int, int]:
        """Random bytes, half of them behind a valid header."""
        for k in range(500):
            head = rtps.message(self.draw.randbytes(12)) if self.draw.random() < 0.5 else b""
            self.victim.send(head + self.draw.randbytes(self.draw.choice((0, 1, 4, 19, 60, 500, 9000, 60000))))
            self.pause(k)
        return 1000, 0

    def lies(self) -> tuple[int, int]:
        """Well-formed datagrams in the talker's name that say what is not so."""
        talker, victim, writers = self.names()
        writer, _ = self.draw.choice(writers)
        far = self.draw.choice((100, 1 << 20, rtps.FAR_AHEAD, (1 << 63) - 2))
        count = self.draw.randrange(1 << 31)
        goodbye = rtps.parameter(0x71, b"\0\0\0\3") + struct.pack("<HH", 1, 0)
        me = rtps.parameters(rtps.parameter(0x50, talker + b"\x00\x00\x01\xc1"))
        lie = self.draw.choice(
            (
                rtps.heartbeat(writer, far, far, count),
                rtps.heartbeat(writer, 1, far, count),
                rtps.gap(writer, 1, far),
                rtps.data(writer, far, rtps.string(b"forged")),
                rtps.acknack(rtps.ANYBODY, rtps.PUBLICATIONS_WRITER, far, count),
                rtps.heartbeat(rtps.LIVELINESS_WRITER, far, far, count),
                rtps.data(rtps.SPDP_WRITER, far, me, rtps.SPDP_READER, goodbye),
            )
        )
        self.victim.send(rtps.message(talker, rtps.info_destination(victim), lie))
        if self.draw.random() < 0.3:  # and an announcement with addresses where nobody is
            time.sleep(0.02)
            self.victim.send(rtps.templates(talker, victim, writer)[-1])
            return 4, 0
        return 2, 0

    def giants(self) -> tuple[int, int]:
        """Samples near and over the largest, claims of far larger ones, and fragments of samples that never come."""
        talker, victim, writers = self.names()
        sent = refused = 0
        for size in (1 << 20, self.draw.choice((60 << 20, 63 << 20, 64 << 20, 65 << 20))):
            try:
                self.talker.reliable._writer.write(rtps.string(b"x" * size))
            except RosError:
                refused += 1
            sent += 1
            self.talker.until(lambda: False, 0.5)
        for writer, _ in writers:
            for k in range(100):
                claimed = self.draw.choice((1 << 16, 60 << 20, 65 << 20, 0x7FFFFFFF, 0xFFFFFFFF))
                piece = rtps.fragment(writer, 50_000_000 + k, 1, 60_000, claimed, self.draw.randbytes(60_000))
                self.victim.send(rtps.message(talker, rtps.info_destination(victim), piece))
                sent += 2
                self.pause(k)
        return sent, refused

    def crowd(self) -> tuple[int, int]:
        """Announcements of participants that do not exist, for a second each."""
        for k in range(300):
            prefix = self.draw.randbytes(12)
            (announced,) = rtps.templates(prefix, b"\0" * 12, b"\0\0\1\3")[-1:]
            self.victim.send(announced.replace(struct.pack("<iI", 10, 0), struct.pack("<iI", 1, 0)))
            self.pause(k)
        return 600, 0


def decode_alone(draw: random.Random, seconds: float) -> str:
    """Mutate the bytes of messages and decode them in this process: `RosError` or a message, and nothing else."""
    tried = refused = 0
    slowest = 0.0
    end = time.monotonic() + seconds
    good = {name: bytes(messages.encode(name, messages.make(name))) + draw.randbytes(64) for name in DECODED}
    while time.monotonic() < end:
        for name, seed in good.items():
            raw = rtps.mutated(draw, [b"\0" * 20 + seed])[20:]
            start = time.perf_counter()
            try:
                messages.decode(name, raw)
            except RosError:
                refused += 1
            slowest = max(slowest, time.perf_counter() - start)
            tried += 1
    return f"decoder alone: {tried} mutated messages, {refused} refused, slowest {1e3 * slowest:.1f} ms"


def still_receive_thread(domain: int) -> str:
    """Make Cyclone's receive thread wait for ever: the node has to end with a code and a sentence, as only that heals."""
    code = (
        "import sys\n"
        "from pieper.ros import open_bus\n"
        "from pieper.ros.bare import loopback\n"
        f"bus = open_bus('victim', backend='bare', domain={domain})\n"
        "loopback._log(7)\n"  # let Cyclone write its warnings after all
        f"print(*[s.port for s in loopback.receivers({domain})], flush=True)\n"
        "try:\n    bus.spin()\nexcept Exception as error:\n    print(error, flush=True)\n    raise SystemExit(3)\n"
    )
    node = subprocess.Popen(
        [sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert node.stdout is not None
    victim = Victim.__new__(Victim)
    victim.state = {"ports": [int(port) for port in node.stdout.readline().split()]}
    start = time.monotonic()
    while time.monotonic() - start < 1.0:
        victim.send(rtps.message(b"nobody there", rtps.submessage(0x15, 0, b"cut off")))
        time.sleep(0.0005)
    try:
        node.wait(60.0)  # and not communicate(), which would read what nobody shall read
    except subprocess.TimeoutExpired:
        node.kill()
        raise AssertionError("a node whose receive thread stands still goes on deaf") from None
    said = node.stdout.read()
    assert node.returncode != 0, said
    assert "start it anew" in said, said
    return f"receive thread stands still: exit code {node.returncode} after {time.monotonic() - start:.0f} s: {said.strip()}"


def main() -> None:
    """Attack until the time is over, and print what came out."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("-max_total_time", type=float, default=600.0, help="seconds")
    parser.add_argument("-rounds", type=int, default=1_000_000)
    parser.add_argument("-seed", type=int, default=1)
    parser.add_argument("-only", default="", help="one attack")
    options, _ = parser.parse_known_args()
    draw = random.Random(options.seed)
    end = time.monotonic() + options.max_total_time
    domain = 216 + os.getpid() % 15
    print(decode_alone(draw, min(20.0, options.max_total_time / 20)), flush=True)
    print(still_receive_thread(domain + 1), flush=True)
    victim, talker = Victim(domain), Talker(domain)
    attacker = Attacker(draw, victim, talker)
    attacks = {
        a.__name__: a
        for a in (
            attacker.malformed_samples,
            attacker.mutated_datagrams,
            attacker.noise,
            attacker.lies,
            attacker.giants,
            attacker.crowd,
        )
        if options.only in ("", a.__name__)
    }
    records = {name: Record() for name in attacks}
    try:
        assert talker.until(lambda: victim.state.get("sensor", 0) > 5, 30.0) is not None, (
            "the node never heard anything"
        )
        start = victim.memory
        for _ in range(options.rounds):
            if time.monotonic() > end:
                break
            name, attack = draw.choice(list(attacks.items()))
            record, said, before = records[name], len(victim.deaf), victim.memory
            sent, refused = attack()
            took = talker.hearing(victim, SOON)
            assert victim.alive, f"{name} ended the node with code {victim.process.returncode}"
            assert took is not None, (
                f"the node does not hear {talker.unheard} after {name}, and said {victim.deaf[said:]}; it has "
                f"{victim.state['publishers']} publishers on the reliable topic; the talker has "
                f"{talker.reliable.subscribers} and {talker.sensor.subscribers} subscribers"
            )
            assert victim.memory < start + MEMORY, (
                f"the node has grown from {start:.0f} to {victim.memory:.0f} MiB by {name}"
            )
            assert not victim.state["reachable"], f"after {name} others can reach {victim.state['reachable']}"
            record.rounds += 1
            record.sent += sent
            record.refused += refused
            record.deaf += len(victim.deaf) - said
            record.slowest = max(record.slowest, took)
            record.grown = max(record.grown, victim.memory - before)
        print(f"node: {start:.0f} MiB at the start, {victim.memory:.0f} MiB at the end, ", end="")
        print(f"{victim.state['undecodable']} samples dropped as undecodable")
    finally:
        print(
            "\n| attack | rounds | messages | refused by the sender | said to be deaf | heard again after at most | grew by at most |"
        )
        print("| --- | --- | --- | --- | --- | --- | --- |")
        for name, r in records.items():
            print(
                f"| {name.replace('_', ' ')} | {r.rounds} | {r.sent} | {r.refused} | {r.deaf} | {r.slowest:.1f} s | {r.grown:.0f} MiB |"
            )
        talker.close()
        code = victim.close()
    assert code == 0, f"the node ended with code {code}"


if __name__ == "__main__":
    main()
