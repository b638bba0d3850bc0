"""The telemetry ring: rows come out whole, in order and accounted for, whatever the reader's pace."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.realtime.atomics import load_acquire, store_release
from qrobot.realtime.jit import jit_disabled, kernel
from qrobot.servo.memory.telemetry import TelemetryLayout, TelemetryReader, append_row, ring_words

BASE = 24  # a ring is a region of a larger segment
JOINTS = st.integers(1, 9)
ROWS_UNDER_CONTENTION = 300 if jit_disabled() else 400_000


def make_ring(n: int, capacity: int) -> np.ndarray[Any, np.dtype[np.int64]]:
    return np.full(BASE + ring_words(TelemetryLayout(n).row_words, capacity) + 8, 0, dtype=np.int64)


def append(words: Any, capacity: int, n: int, value: int) -> None:
    row_words = TelemetryLayout(n).row_words
    append_row(words, BASE, capacity, row_words, np.full(row_words, value, dtype=np.int64))


@given(n=JOINTS, log2=st.integers(1, 5), steps=st.lists(st.tuples(st.integers(0, 40), st.integers(1, 40)), max_size=8))
def test_every_row_is_delivered_once_in_order_or_counted_as_lost(n: int, log2: int, steps: Any) -> None:
    capacity = 1 << log2
    words = make_ring(n, capacity)
    reader = TelemetryReader(words, BASE, capacity, n)
    written, seen = 0, []
    for appended, room in steps:
        for _ in range(appended):
            append(words, capacity, n, written)
            written += 1
        seen += reader.read(room)["tick"].tolist()
        assert len(seen) + reader.lost == reader.next_row
    while (rows := reader.read()).size:
        seen += rows["tick"].tolist()
    assert len(seen) + reader.lost == written
    assert seen == sorted(set(seen))
    assert seen[-(capacity - 1) :] == list(range(max(0, written - capacity + 1), written))[-len(seen) :]


@given(n=JOINTS, log2=st.integers(1, 5), appended=st.integers(0, 80))
def test_a_ring_stays_within_its_region(n: int, log2: int, appended: int) -> None:
    capacity = 1 << log2
    words = make_ring(n, capacity)
    words[:BASE], words[-8:] = 11, 22
    for i in range(appended):
        append(words, capacity, n, i)
    assert (words[:BASE] == 11).all()
    assert (words[-8:] == 22).all()
    assert words[BASE] == appended


@given(n=JOINTS)
def test_names_words_and_dtype_describe_the_same_bytes(n: int) -> None:
    layout = TelemetryLayout(n)
    words = np.arange(layout.row_words, dtype=np.int64)
    row = words.view(layout.dtype)[0]
    assert layout.dtype.itemsize == 8 * layout.row_words
    for name in ("tick", "t_ns", "late_ns", "busy_ns", "mode", "fault", "setpoint_seq", "flags"):
        assert row[name] == layout.offset(name)
    for name in ("counts", "dac"):
        np.testing.assert_array_equal(row[name], layout.offset(name) + np.arange(n))
    for name in ("q_ref", "v_ref", "a_ref", "q", "v", "tau"):
        expected = words[layout.offset(name) : layout.offset(name) + n]
        np.testing.assert_array_equal(row[name].view(np.int64), expected)


def test_the_order_of_fields_is_the_published_one() -> None:
    names = "tick t_ns late_ns busy_ns mode fault setpoint_seq flags q_ref v_ref a_ref q v tau counts dac "
    names += "gravity friction volts force signals inputs outputs event_joint program_signals payload override"
    assert TelemetryLayout(6).dtype.names == tuple(names.split())
    assert TelemetryLayout(6).row_words == 12 + 10 * 6 + 8 + 6 + 8 + 8 + 10


def test_a_late_reader_starts_with_the_oldest_whole_row_or_with_the_next_one() -> None:
    words = make_ring(2, 8)
    for i in range(20):
        append(words, 8, 2, i)
    assert TelemetryReader(words, BASE, 8, 2).read()["tick"].tolist() == list(range(13, 20))
    newest = TelemetryReader(words, BASE, 8, 2, from_oldest=False)
    assert newest.read().size == 0
    append(words, 8, 2, 20)
    assert newest.read()["tick"].tolist() == [20]
    assert newest.lost == 0


def test_rows_that_go_while_a_late_reader_gets_ready_are_not_lost_and_those_afterwards_are() -> None:
    words = make_ring(2, 8)
    for i in range(20):
        append(words, 8, 2, i)
    reader = TelemetryReader(words, BASE, 8, 2)
    for i in range(20, 23):
        append(words, 8, 2, i)
    assert reader.read()["tick"].tolist() == list(range(16, 23))
    assert reader.lost == 0
    for i in range(23, 40):
        append(words, 8, 2, i)
    assert reader.read()["tick"].tolist() == list(range(33, 40))
    assert reader.lost == 10


@pytest.mark.parametrize(("early", "lost"), [(14, 4), (15, 0), (16, 0)])
def test_a_reader_that_comes_as_the_ring_gets_full_loses_no_row_either(early: int, lost: int) -> None:
    words = make_ring(1, 16)
    for i in range(early):
        append(words, 16, 1, i)
    reader = TelemetryReader(words, BASE, 16, 1)
    for i in range(early, 19):
        append(words, 16, 1, i)
    assert (reader.read()["tick"][0], reader.lost) == (4, lost)


def test_a_ring_that_was_reset_yields_nothing_instead_of_old_rows() -> None:
    words = make_ring(2, 8)
    reader = TelemetryReader(words, BASE, 8, 2)
    for i in range(5):
        append(words, 8, 2, i)
    assert reader.read().size == 5
    words[BASE:] = 0  # a new servo took the memory over
    append(words, 8, 2, 100)
    assert reader.read().size == 0
    assert reader.lost == 0


def test_rows_are_copies_that_later_reads_do_not_change() -> None:
    words = make_ring(1, 8)
    reader = TelemetryReader(words, BASE, 8, 1)
    append(words, 8, 1, 1)
    first = reader.read()
    append(words, 8, 1, 2)
    reader.read()
    assert first["tick"].tolist() == [1]


@kernel
def write_many(words: Any, base: int, capacity: int, row_words: int, row: Any, rows: int, stop: int) -> None:
    """Append rows whose words are all equal to their index, as fast as possible."""
    for k in range(rows):
        if load_acquire(words, stop) != 0:
            return
        for i in range(row_words):
            row[i] = k
        append_row(words, base, capacity, row_words, row)


@kernel
def end(words: Any, index: int) -> None:
    """Raise the writer's stop flag; intrinsics are only callable from compiled code."""
    store_release(words, index, 1)


@pytest.mark.parametrize(("n", "capacity"), [(6, 4), (6, 64), (1, 1024)])
def test_no_row_is_torn_beside_a_writer_that_never_pauses(n: int, capacity: int) -> None:
    words, row_words = make_ring(n, capacity), TelemetryLayout(n).row_words
    row = np.zeros(row_words, dtype=np.int64)
    write_many(words, BASE, capacity, row_words, row, 0, 0)  # compiled before the clock runs
    reader = TelemetryReader(words, BASE, capacity, n)
    writer = threading.Thread(target=write_many, args=(words, BASE, capacity, row_words, row, ROWS_UNDER_CONTENTION, 0))
    writer.start()
    last, delivered = -1, 0
    while writer.is_alive() or reader.next_row < ROWS_UNDER_CONTENTION:
        block = reader.read().view(np.int64).reshape(-1, row_words)
        if block.size:
            assert (block == block[:, :1]).all()
            assert block[0, 0] > last
            assert (np.diff(block[:, 0]) == 1).all()
            last, delivered = int(block[-1, 0]), delivered + len(block)
    end(words, 0)
    writer.join()
    assert delivered + reader.lost == ROWS_UNDER_CONTENTION
    assert last == ROWS_UNDER_CONTENTION - 1
