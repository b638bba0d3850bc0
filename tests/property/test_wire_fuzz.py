"""Hostile bytes: one kind of error, bounded memory, no motion that nobody could have asked for."""

from __future__ import annotations

import random
import tracemalloc
from collections import Counter
from math import isfinite

import pytest

from qrobot.errors import RemoteProtocolError
from qrobot.rccl_bridge import BridgeSettings, Forward, Lease, Session
from qrobot.rccl_bridge.session import Peer
from qrobot.wire import Connection, Conversation, Side
from tests.support.mutants import SEEDS, N, mutant
from tests.support.thorough import wide

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
    "letters, digits and underscores",
    "while the conversation is",
)


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


@pytest.mark.parametrize("count", [40_000, *wide(200_000)])
def test_mutants_cause_one_kind_of_error_and_every_reason_for_it(count: int) -> None:
    rng = random.Random(56)
    hits: Counter[str] = Counter()
    connection = connection_somewhere(rng)
    for _ in range(count):
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
