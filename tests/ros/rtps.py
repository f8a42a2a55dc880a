"""RTPS messages made by hand [OMG RTPS 2.5, section 9.4], to say over UDP what no DDS would: forged and mutated ones."""

from __future__ import annotations

import random
import struct

FAR_AHEAD = 1 << 40
"""A sequence number that no writer reaches."""

ANYBODY = b"\0\0\0\0"
SPDP_WRITER = b"\x00\x01\x00\xc2"
SPDP_READER = b"\x00\x01\x00\xc7"
PUBLICATIONS_WRITER = b"\x00\x00\x03\xc2"
SUBSCRIPTIONS_WRITER = b"\x00\x00\x04\xc2"
LIVELINESS_WRITER = b"\x00\x02\x00\xc2"


def message(prefix: bytes, *submessages: bytes) -> bytes:
    """A datagram in the name of a participant: the first 12 bytes of its GUID."""
    return b"RTPS\x02\x05\x01\x10" + prefix + b"".join(submessages)


def submessage(kind: int, flags: int, body: bytes) -> bytes:
    return struct.pack("<BBH", kind, flags | 1, len(body)) + body


def sequence_number(value: int) -> bytes:
    return struct.pack("<iI", value >> 32, value & 0xFFFFFFFF)


def heartbeat(writer: bytes, first: int, last: int, count: int, reader: bytes = ANYBODY) -> bytes:
    return submessage(
        0x07, 2, reader + writer + sequence_number(first) + sequence_number(last) + struct.pack("<I", count)
    )


def gap(writer: bytes, start: int, end: int, reader: bytes = ANYBODY) -> bytes:
    return submessage(0x08, 0, reader + writer + sequence_number(start) + sequence_number(end) + struct.pack("<I", 0))


def data(writer: bytes, number: int, payload: bytes, reader: bytes = ANYBODY, inline_qos: bytes = b"") -> bytes:
    flags = (2 if inline_qos else 0) | 4
    head = struct.pack("<HH", 0, 16) + reader + writer + sequence_number(number)
    return submessage(0x15, flags, head + inline_qos + payload)


def fragment(writer: bytes, number: int, first: int, size: int, sample_size: int, payload: bytes) -> bytes:
    head = struct.pack("<HH", 0, 28) + ANYBODY + writer + sequence_number(number)
    return submessage(0x16, 0, head + struct.pack("<IHHI", first, 1, size, sample_size) + payload)


def acknack(reader: bytes, writer: bytes, base: int, count: int) -> bytes:
    return submessage(0x06, 2, reader + writer + sequence_number(base) + struct.pack("<II", 0, count))


def info_destination(prefix: bytes) -> bytes:
    return submessage(0x0E, 0, prefix)


def info_timestamp(seconds: int = 1_700_000_000) -> bytes:
    return submessage(0x09, 0, struct.pack("<II", seconds, 0))


def string(text: bytes) -> bytes:
    """CDR of ``std_msgs/msg/String``."""
    return b"\0\1\0\0" + struct.pack("<I", len(text) + 1) + text + b"\0" * (4 - len(text) % 4)


def parameter(identifier: int, value: bytes) -> bytes:
    value += b"\0" * (-len(value) % 4)
    return struct.pack("<HH", identifier, len(value)) + value


def parameters(*members: bytes) -> bytes:
    return b"\0\3\0\0" + b"".join(members) + struct.pack("<HH", 1, 0)


def publication(prefix: bytes, entity: bytes, topic: bytes, type_name: bytes) -> bytes:
    """What a participant tells of one of its writers [section 9.6.3]."""
    return parameters(
        parameter(0x50, prefix + b"\x00\x00\x01\xc1"),
        parameter(0x5A, prefix + entity),
        parameter(0x05, struct.pack("<I", len(topic) + 1) + topic + b"\0"),
        parameter(0x07, struct.pack("<I", len(type_name) + 1) + type_name + b"\0"),
        parameter(0x1A, struct.pack("<IiI", 2, 0, 429496729)),
    )


def templates(talker: bytes, victim: bytes, writer: bytes) -> list[bytes]:
    """Well-formed messages of every kind, in the name of a talker (12 bytes) and of one of its writers (4 bytes)."""
    to, now = info_destination(victim), info_timestamp()
    return [
        message(talker, to, heartbeat(writer, 1, 10, 1000)),
        message(talker, to, heartbeat(PUBLICATIONS_WRITER, 1, 5, 1000)),
        message(talker, to, heartbeat(SUBSCRIPTIONS_WRITER, 1, 5, 1000), heartbeat(LIVELINESS_WRITER, 1, 1, 1000)),
        message(talker, to, gap(writer, 1, 2)),
        message(talker, now, data(writer, 10, string(b"forged"))),
        message(talker, now, data(writer, 11, string(b"forged")), heartbeat(writer, 1, 11, 1001)),
        message(talker, now, fragment(writer, 12, 1, 1024, 3000, string(b"f" * 1000))),
        message(talker, now, fragment(writer, 13, 65535, 65535, 0xFFFFFFFF, b"f" * 1000)),
        message(talker, to, acknack(b"\x00\x00\x03\xc7", PUBLICATIONS_WRITER, 2, 1000)),
        message(talker, to, acknack(b"\x00\x00\x04\xc7", SUBSCRIPTIONS_WRITER, 1, 1001)),
        message(
            talker, to, submessage(0x12, 0, ANYBODY + writer + sequence_number(9) + struct.pack("<IIII", 1, 32, 1, 1))
        ),
        message(talker, to, submessage(0x13, 0, ANYBODY + writer + sequence_number(9) + struct.pack("<II", 3, 7))),
        message(talker, submessage(0x0C, 0, b"\0\0\0\0\x02\x01\x01\x10" + victim), heartbeat(writer, 1, 10, 1002)),
        message(talker, submessage(0x0F, 0, struct.pack("<IiI", 1, 1, 7400) + b"\0" * 12 + b"\x7f\0\0\1"), now),
        message(
            talker, now, data(PUBLICATIONS_WRITER, 6, publication(talker, b"\x00\x00\x77\x03", b"rt/forged", b"T"))
        ),
        message(
            talker,
            now,
            data(
                SPDP_WRITER,
                2,
                parameters(
                    parameter(0x15, b"\x02\x05\0\0"),
                    parameter(0x16, b"\x01\x10\0\0"),
                    parameter(0x50, talker + b"\x00\x00\x01\xc1"),
                    parameter(0x58, struct.pack("<I", 0xC3F)),
                    parameter(0x02, struct.pack("<iI", 10, 0)),
                    parameter(0x31, struct.pack("<iI", 1, 7410) + b"\0" * 12 + b"\x7f\0\0\1"),
                    parameter(0x32, struct.pack("<iI", 1, 7411) + b"\0" * 12 + b"\x7f\0\0\1"),
                ),
                SPDP_READER,
            ),
        ),
    ]


_NUMBERS = (0, 1, 2, 255, 65535, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x40000000, 1 << 20)


def mutated(draw: random.Random, seeds: list[bytes]) -> bytes:
    """A message with a few bytes, numbers or pieces wrong; in two of three cases behind an intact header."""
    raw = bytearray(draw.choice(seeds))
    start = 20 if draw.random() < 0.67 else 0
    for _ in range(draw.choice((1, 1, 2, 3, 8, 30))):
        if len(raw) <= start + 4:
            break
        where = draw.randrange(start, len(raw))
        kind = draw.randrange(7)
        if kind == 0:
            raw[where] = draw.randrange(256)
        elif kind == 1:
            raw[where] ^= 1 << draw.randrange(8)
        elif kind == 2:
            del raw[where:]
        elif kind == 3:
            raw[where : where + 4] = struct.pack(draw.choice("<>") + "I", draw.choice(_NUMBERS))
        elif kind == 4:
            raw[where:where] = draw.randbytes(draw.choice((1, 4, 16, 200)))
        elif kind == 5:
            raw += draw.choice(seeds)[20:]
        else:
            del raw[where : where + draw.choice((1, 4, 8))]
    return bytes(raw[:60000])
