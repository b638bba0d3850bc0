"""Packets that lie: a mutator that knows their structure, so that its lies get past magic, length and checksum.

It is seeded by its caller: every run is the same.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from zlib import crc32

from qrobot.wire import (
    Bye,
    ClientRole,
    Command,
    ErrorCode,
    Hello,
    Payload,
    Signals,
    State,
    Stop,
    Welcome,
    WireError,
)
from qrobot.wire.codec import encode
from qrobot.wire.layout import CRC_BYTES, HEADER_BYTES
from tests.support.packets import resting

N = 6
SEEDS = [
    encode(packet)
    for packet in (
        Hello(ClientRole.COMMANDER, "puma560", "fuzz", 28_000, b"token"),
        Hello(ClientRole.OBSERVER, ""),
        Welcome(ClientRole.COMMANDER, "puma560", N, 28_000),
        Command(5, (1,) * N, (0.1,) * N, power=True),
        Command(6, (2, 1, 0, 0, 0, 0), (0.1,) * N, stop=True),
        State(7, resting((0.2,) * N)),
        Command(8, (1,), (0.1,)),  # to and from a robot of one joint
        State(9, resting((0.2,))),
        WireError(ErrorCode.FULL, "full", fatal=True),
        Bye("done"),
        Stop(power_off=True),
        Signals(("pressure", "depth")),
        Payload(2.0, (0.0, 0.0, 0.1)),
    )
]
WILD_WORDS = (0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x7FF00000, 0xFFF80000, 0x7FEFFFFF)
WILD_LENGTHS = (0, 4, 28, 100, 4096, 4100, 65535)


def sealed(frame: bytearray) -> bytes:
    """A frame whose checksum is right whatever it says."""
    body = bytes(frame[:-CRC_BYTES])
    return body + crc32(body).to_bytes(4, "little")


def truncate(frame: bytearray, rng: random.Random) -> bytes:
    return bytes(frame[: rng.randrange(len(frame))])


def lie_about_length(frame: bytearray, rng: random.Random) -> bytes:
    frame[6:8] = rng.choice(WILD_LENGTHS).to_bytes(2, "little")
    return sealed(frame)


def resize_honestly(frame: bytearray, rng: random.Random) -> bytes:
    size = 4 * rng.randrange(HEADER_BYTES // 4 + 1, 1024)
    frame = (frame[:-CRC_BYTES] + bytes(size))[:size]
    frame[6:8] = size.to_bytes(2, "little")
    return sealed(frame)


def wrap_sequence(frame: bytearray, rng: random.Random) -> bytes:
    frame[8:12] = rng.choice(WILD_WORDS).to_bytes(4, "little")
    return sealed(frame)


def go_wild(frame: bytearray, rng: random.Random) -> bytes:
    at = 4 * rng.randrange(HEADER_BYTES // 4, len(frame) // 4 - 1) if len(frame) > HEADER_BYTES + 8 else 8
    frame[at : at + 4] = rng.choice(WILD_WORDS).to_bytes(4, "little")
    return sealed(frame)


def change_kind(frame: bytearray, rng: random.Random) -> bytes:
    frame[rng.choice((4, 5))] = rng.randrange(256)
    return sealed(frame)


def flip(frame: bytearray, rng: random.Random) -> bytes:
    frame[rng.randrange(len(frame))] ^= 1 << rng.randrange(8)
    return bytes(frame)


def leave(frame: bytearray, rng: random.Random) -> bytes:
    return bytes(frame)


MUTATIONS: tuple[Callable[[bytearray, random.Random], bytes], ...] = (
    truncate, lie_about_length, resize_honestly, wrap_sequence, go_wild, change_kind, flip, leave,
)  # fmt: skip


def mutant(rng: random.Random) -> bytes:
    return rng.choice(MUTATIONS)(bytearray(rng.choice(SEEDS)), rng)
