"""Hostile bytes: one kind of error, bounded memory, no motion that nobody could have asked for.

The mutator knows the structure of packets, so that its lies get past magic, length and checksum. It is seeded: every
run is the same.
"""

from __future__ import annotations

import random
import tracemalloc
from collections import Counter
from collections.abc import Callable
from math import isfinite
from zlib import crc32

from qrobot.errors import RemoteProtocolError
from qrobot.rccl_bridge import BridgeSettings, Forward, Lease, Session
from qrobot.rccl_bridge.session import Peer
from qrobot.wire import (
    Bye,
    ClientRole,
    Command,
    Connection,
    Conversation,
    ErrorCode,
    Hello,
    Side,
    State,
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
    )
]
REASONS = (
    "no packet begins with",
    "impossible packet length",
    "wrong checksum",
    "of the protocol, this is version",
    "unknown kind of packet",
    "bytes, not",  # of the wrong size for what it is
    "joints: 1 to 32 are possible",
    "to a robot of",
    "from a robot of",
    "bytes of authentication",
    "WELCOME to a period",
    "joint modes",
    "unknown role",
    "not UTF-8",
    "while the conversation is",
)
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


def connection_somewhere(rng: random.Random) -> Connection:
    connection = Connection(rng.choice((Side.CLIENT, Side.SERVER)))
    connection.conversation, connection.n = rng.choice(list(Conversation)), N
    return connection


def feed(connection: Connection, data: bytes) -> str:
    """Why the connection stopped listening, "" when it did not."""
    try:
        connection.receive_data(data)
        while connection.next_event() is not None:
            pass
    except RemoteProtocolError as error:
        return str(error)
    return ""


def reason_in(error: str) -> str:
    """The reason among those known; a new one has to be listed."""
    return next(reason for reason in REASONS if reason in error)


def test_two_hundred_thousand_mutants_cause_one_kind_of_error_and_every_reason_for_it() -> None:
    rng = random.Random(56)
    hits: Counter[str] = Counter()
    connection = connection_somewhere(rng)
    for _ in range(200_000):
        if error := feed(connection, mutant(rng)):
            hits[reason_in(error)] += 1
            connection = connection_somewhere(rng)
        elif connection.ended:
            connection = connection_somewhere(rng)
    assert set(hits) == set(REASONS)


def test_memory_does_not_grow_with_the_number_of_mutants() -> None:
    rng = random.Random(57)
    tracemalloc.start()
    try:
        for _ in range(2_000):
            feed(connection_somewhere(rng), mutant(rng))
        before = tracemalloc.get_traced_memory()[0]
        for _ in range(10_000):
            feed(connection_somewhere(rng), mutant(rng))
        assert tracemalloc.get_traced_memory()[0] - before < 100_000
    finally:
        tracemalloc.stop()


def test_mutants_never_give_the_servo_anything_but_well_formed_finite_frames() -> None:
    rng = random.Random(58)
    forwarded = 0
    for k in range(5_000):
        session = Session("puma560", N, Lease(), BridgeSettings(), Peer("127.0.0.1", 1), 0)
        actions = session.receive(SEEDS[0] if k % 10 else mutant(rng), 0)
        for _ in range(10):
            actions += session.receive(mutant(rng), 0)
        frames = [action.frame for action in actions if isinstance(action, Forward)]
        forwarded += len(frames)
        for frame in frames:
            assert len(frame.setpoints) == len(frame.modes) == N
            assert all(isfinite(setpoint) and abs(setpoint) <= 1e6 for setpoint in frame.setpoints)
            assert set(frame.modes) <= {0, 1, 2}
        assert [frame.seq for frame in frames] == sorted({frame.seq for frame in frames})
    assert forwarded > 100
