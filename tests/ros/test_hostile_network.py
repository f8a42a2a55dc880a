"""Who sends nonsense, or lies, to a node on bare DDS: it does not crash, does not grow, and is not deaf without saying so."""

import os
import random
import socket
import struct
import sys
from contextlib import suppress
from pathlib import Path

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed")
if sys.platform != "linux":
    pytest.skip("sockets are kept to the loopback interface on Linux only", allow_module_level=True)

from cyclonedds.core import DDSException
from cyclonedds.domain import DomainParticipant
from hypothesis import given
from hypothesis import strategies as st

from pieper.errors import RosError
from pieper.ros import open_bus
from pieper.ros.bare import loopback, watchdog
from tests.ros import rtps
from tests.ros.hostile import Talker, Victim

DOMAIN = 216 + os.getpid() % 15  # whose ports the kernel gives to nobody else
MEMORY = (
    32.0  # MiB that a node may grow by: buffers of the interpreter and of Cyclone; an attack that is kept sends more
)
RECOVERY = 45.0  # s: a stalled machine may take long, so this is only where the waiting ends


@pytest.fixture(scope="module")
def pair():
    """A victim and a talker that it hears."""
    victim, talker = Victim(DOMAIN), Talker(DOMAIN)
    try:
        assert talker.until(lambda: victim.state.get("sensor", 0) > 5, 30.0) is not None
        yield victim, talker
    finally:
        talker.close()
        code = victim.close()
    assert code == 0


def test_no_socket_of_a_node_can_be_reached_from_outside(pair):
    victim, _ = pair
    assert len(victim.state["ports"]) == 2
    assert victim.state["reachable"] == []
    # what the kernel says: the node does have sockets at every address, and it is the device that keeps them in
    inodes = {
        str(f.readlink())[8:-1]
        for f in Path(f"/proc/{victim.process.pid}/fd").iterdir()
        if str(f.readlink()).startswith("socket:")
    }
    rows = [line.split() for name in ("udp", "udp6") for line in Path(f"/proc/net/{name}").read_text().splitlines()[1:]]
    mine = {int(row[1].split(":")[1], 16): row[1].split(":")[0] for row in rows if row[9] in inodes}
    assert set(victim.state["ports"]) <= set(mine)
    assert {mine[port] for port in victim.state["ports"]} == {"00000000"}


def test_a_socket_that_can_be_reached_is_seen():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        assert one.fileno() not in [s.fd for s in loopback.sockets() if s.reachable]
        one.bind(("0.0.0.0", 0))
        assert one.fileno() in [s.fd for s in loopback.sockets() if s.reachable]
        one.setsockopt(socket.SOL_SOCKET, loopback.SO_BINDTODEVICE, b"lo\0")
        assert one.fileno() not in [s.fd for s in loopback.sockets() if s.reachable]


def test_sockets_of_others_are_left_alone():
    port = 7400 + 250 * DOMAIN + 249  # among those of the domain
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", port))
        bus = open_bus("node", backend="bare", domain=DOMAIN)
        bus.close()
        (seen,) = [s for s in loopback.sockets() if s.fd == other.fileno()]
        assert seen.device == ""


def test_where_sockets_cannot_be_tied_down_nothing_is_opened(monkeypatch):
    def refuse(*_):
        raise PermissionError(1, "Operation not permitted")

    before = {s.inode for s in loopback.sockets()}
    with monkeypatch.context() as patch:
        patch.setattr(socket.socket, "setsockopt", refuse)
        with pytest.raises(RosError, match=r"Operation not permitted.*Linux 5.7.*--network"):
            loopback.open_domain(DOMAIN + 1)
    assert {s.inode for s in loopback.sockets()} <= before
    with monkeypatch.context() as patch:
        patch.setattr(sys, "platform", "darwin")
        with pytest.raises(RosError, match=r"darwin.*--network"):
            loopback.open_domain(DOMAIN + 1)


def test_a_missing_network_interface_is_named(monkeypatch):
    monkeypatch.setattr(loopback, "LOOPBACK", "nosuch0")
    with pytest.raises(RosError, match="'nosuch0' is missing or down: bring it up"):
        loopback.open_domain(DOMAIN + 1)


def test_a_full_domain_says_so():
    taken = []
    try:
        for index in range(loopback.LAST_INDEX + 1):
            taken.append(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            with suppress(OSError):  # taken already
                taken[-1].bind(("127.0.0.1", 7400 + 250 * (DOMAIN + 1) + 10 + 2 * index))
        with pytest.raises(RosError, match=r"is full: all 120 participant indices.*another ROS_DOMAIN_ID"):
            loopback.open_domain(DOMAIN + 1)
    finally:
        for one in taken:
            one.close()


def test_a_domain_that_is_in_use_says_so(monkeypatch):
    opened = loopback.open_domain(DOMAIN + 1)
    assert loopback.open_domain(DOMAIN + 1) is opened
    with pytest.raises(RosError, match=r"open on the loopback and is now asked for it on the network"):
        loopback.open_domain(DOMAIN + 1, network=True)
    loopback.close_domain(opened)
    monkeypatch.setenv("CYCLONEDDS_URI", loopback.configuration())
    theirs = DomainParticipant(DOMAIN + 1)
    with pytest.raises(RosError, match=r"something else in this process has opened DDS domain"):
        loopback.open_domain(DOMAIN + 1)
    theirs.__del__()
    with pytest.raises(RosError, match=r"0 ... 232, got 233"):
        loopback.open_domain(233)


def test_settings_of_the_user_hold_on_the_network_only(monkeypatch):
    monkeypatch.setenv("CYCLONEDDS_URI", "<their/>")
    assert loopback.configuration(network=True) == "<their/>"
    assert "their" not in loopback.configuration()
    assert "CYCLONEDDS_URI" in loopback.explain(DDSException(-1), domain=0, network=True)
    monkeypatch.setenv("CYCLONEDDS_URI", "file:///settings/\u00e4.xml")
    with pytest.raises(RosError, match="not ASCII"):
        loopback.open_domain(DOMAIN + 1, network=True)


def test_nothing_is_asked_of_a_port_beyond_the_last():
    assert "<MaxAutoParticipantIndex>119<" in loopback.configuration(231)
    assert "<MaxAutoParticipantIndex>62<" in loopback.configuration(232)  # 65410 + 2 * 62 + 1 = 65535


class _Matched:
    """A reader with so many writers."""

    def __init__(self, writers):
        self._writers = writers

    def get_matched_publications(self):
        return list(range(self._writers))


class _Ear(watchdog.Ear):
    """An ear whose count of bytes thrown away is told."""

    def discarded(self):
        return self.told


def _ear(writers):
    ear = _Ear("/topic", _reader=_Matched(writers))
    ear.told = 0
    return ear


@given(writers=st.integers(1, 4), growth=st.lists(st.booleans(), max_size=60))
def test_who_is_heard_is_not_taken_for_lost(writers, growth):
    ear = _ear(writers)
    for k, grew in enumerate(growth):
        ear.told += grew
        ear.heard |= set(range(writers))
        assert not ear.loses(0.5 * k)


@given(writers=st.integers(1, 4), silent=st.integers(1, 4), quiet=st.lists(st.integers(0, 3), min_size=8, max_size=30))
def test_who_is_thrown_away_is_lost_soon(writers, silent, quiet):
    """Whatever the others say, and with pauses between."""
    ear = _ear(writers)
    now, found = 0.0, 0
    for pause in quiet:
        ear.told += 100
        for _ in range(pause + 1):
            ear.heard |= set(range(writers - min(silent, writers)))
            now += 0.5
            found += ear.loses(now)
    assert found
    first = _ear(writers)
    checks = [first.loses(0.5 * k) for k in range(6) if setattr(first, "told", 10 * k + 10) is None]
    assert checks.index(True) + 1 == watchdog.LOST


@given(gaps=st.lists(st.floats(watchdog.FORGIVEN[0] + 0.6, 100.0), max_size=20))
def test_duplicates_now_and_then_are_no_loss_while_another_writer_has_nothing_to_say(gaps):
    ear = _ear(2)
    now = 0.0
    for gap in gaps:
        ear.told += 100
        ear.heard.add(0)
        assert not ear.loses(now)
        ear.heard.add(0)
        assert not ear.loses(now + gap - 0.1)
        now += gap


def test_a_queue_that_nobody_empties_stands_still():
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        receiver.bind(("127.0.0.1", 0))
        (seen,) = [s for s in loopback.sockets() if s.fd == receiver.fileno()]
        queue = watchdog._Queue(seen)
        for k in range(3 * watchdog.STILL):  # somebody takes what comes, however much it is
            sender.sendto(b"%d" % k, receiver.getsockname())
            sender.sendto(b"%d" % k, receiver.getsockname())
            assert not queue.stands_still()
            receiver.recv(9)
        assert [queue.stands_still() for _ in range(watchdog.STILL + 1)] == [False] * watchdog.STILL + [True]
        queue.close()


def test_malformed_samples_are_dropped_and_counted(pair):
    victim, talker = pair
    before = victim.memory
    draw = random.Random(2026)
    good = [
        rtps.string(b"good or not"),
        b"\0\1\0\0" + struct.pack("<iI", 1, 2) + rtps.string(b"base")[4:] + struct.pack("<I", 0) * 8,
    ]
    refused = 0
    for _ in range(300):
        raw = bytearray(draw.choice(good))
        for _ in range(draw.choice((1, 2, 5))):
            raw[draw.randrange(len(raw))] = draw.choice((0, 1, 255, draw.randrange(256)))
        try:
            draw.choice((talker.reliable, talker.joints, talker.image))._writer.write(
                bytes(raw[: draw.randrange(4, 80)])
            )
        except RosError:  # Cyclone does not let it out
            refused += 1
    assert refused < 300
    assert talker.hearing(victim, RECOVERY) is not None
    assert victim.memory < before + MEMORY


@pytest.mark.parametrize("kind", ["heartbeat", "gap", "data"])
def test_one_forged_datagram_deafens_a_node_for_seconds_only(pair, kind):
    victim, talker = pair
    said = len(victim.deaf)
    publisher = talker.sensor if kind == "data" else talker.reliable
    topic = "sensor" if kind == "data" else "reliable"
    guid = talker.guid(publisher)
    prefix, writer = guid[:12], guid[12:]
    far = rtps.FAR_AHEAD
    forged = {
        "heartbeat": rtps.heartbeat(writer, far, far, 0x7FFFFFFF),
        "gap": rtps.heartbeat(writer, far - 1, far - 1, 0x7FFFFFF0) + rtps.gap(writer, 1, far),
        "data": rtps.data(writer, far, rtps.string(b"forged")),
    }[kind]
    assert talker.hearing(victim, RECOVERY) is not None
    victim.send(rtps.message(prefix, rtps.info_destination(bytes.fromhex(victim.state["prefix"])), forged))
    assert talker.until(lambda: len(victim.deaf) > said, RECOVERY) is not None, f"deaf and silent: {victim.state}"
    assert any(f"/{topic} arrive and are thrown away" in line for line in victim.deaf[said:])
    assert "participant rebuilt" in victim.deaf[-1]
    assert talker.hearing(victim, RECOVERY) is not None, "deaf after all"


def test_a_forged_goodbye_is_soon_forgotten(pair):
    """The one in whose name it was said goes on announcing itself."""
    victim, talker = pair
    assert talker.hearing(victim, RECOVERY) is not None
    prefix = talker.guid(talker.reliable)[:12]
    me = rtps.parameters(rtps.parameter(0x50, prefix + b"\x00\x00\x01\xc1"))
    goodbye = rtps.parameter(0x71, b"\0\0\0\3") + struct.pack("<HH", 1, 0)
    datagram = rtps.message(prefix, rtps.data(rtps.SPDP_WRITER, 99, me, rtps.SPDP_READER, goodbye))
    # said again until it shows: the state is told ten times a second, and the true one may announce itself in between
    believed = talker.until(lambda: victim.send(datagram) or victim.state["publishers"] == 0, RECOVERY)
    assert believed is not None, "it did not believe it"
    assert talker.hearing(victim, RECOVERY) is not None


def test_who_was_announced_with_a_wrong_address_is_met_again(pair):
    """Cyclone keeps the first addresses that it is told, and so never asks the true one for its topics."""
    victim, talker = pair
    said = len(victim.deaf)
    assert talker.hearing(victim, RECOVERY) is not None
    prefix = talker.guid(talker.reliable)[:12]
    me = rtps.parameters(rtps.parameter(0x50, prefix + b"\x00\x00\x01\xc1"))
    goodbye = rtps.parameter(0x71, b"\0\0\0\3") + struct.pack("<HH", 1, 0)
    farewell = rtps.message(prefix, rtps.data(rtps.SPDP_WRITER, 99, me, rtps.SPDP_READER, goodbye))
    nowhere = rtps.templates(prefix, b"\0" * 12, b"\0\0\1\3")[-1]

    def misled() -> bool:
        """Lie again whenever the talker's own announcement came in between, and the victim knows it after all."""
        if victim.state["publishers"]:
            victim.send(farewell)
            victim.send(nowhere)
        return len(victim.deaf) > said

    assert talker.until(misled, RECOVERY) is not None, f"deaf and silent: {victim.state}"
    assert any("announces itself, but its topics do not become known" in line for line in victim.deaf[said:])
    assert talker.hearing(victim, RECOVERY) is not None


def test_mutated_datagrams_neither_end_a_node_nor_leave_it_deaf(pair):
    """Thousands of warnings of Cyclone, too, which nobody reads: it must not wait for a reader."""
    victim, talker = pair
    before = victim.memory
    guid = talker.guid(talker.reliable)
    draw = random.Random(4)
    seeds = rtps.templates(guid[:12], bytes.fromhex(victim.state["prefix"]), guid[12:])
    for k in range(1500):
        victim.send(rtps.mutated(draw, seeds))
        if k % 50 == 0:
            talker.bus.spin_once(0.001)
    assert victim.alive
    assert talker.hearing(victim, RECOVERY) is not None
    assert victim.memory < before + MEMORY
    assert victim.state["reachable"] == []
