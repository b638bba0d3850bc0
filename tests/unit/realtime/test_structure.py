"""Structured types of shared memory: where their fields lie, and that records, words and C programs see the same."""

from __future__ import annotations

import uuid

import numpy as np
import pytest

from qrobot.errors import LinkError
from qrobot.hwif.board_memory import BOARD_MEMORY, LAYOUT, BoardMemory, attach_board_memory, create_board_memory
from qrobot.realtime.atomics import load_acquire, store_release
from qrobot.realtime.flat_record import block_of, copy_fields, words_of
from qrobot.realtime.jit import lean_kernel
from qrobot.realtime.structure import (
    LINE_BYTES,
    WORD_BYTES,
    StructureField,
    columns_of,
    digest_of,
    dtype_of,
    floats,
    local_record,
    offset_of,
    part,
    record_in,
    text,
    view_words,
    word,
    words,
)
from qrobot.servo.memory.servo_memory import ServoMemory, attach_servo_memory, create_servo_memory, servo_dtype


class Pair:
    """A block in a ring."""

    first: int = word()
    second: int = word()


class Block:
    """One of everything."""

    head: int = word()
    tail: int = word(own_line=True)
    ring = part(Pair, 3)
    places = floats("n")
    grid = words((2, "n"))
    name = text(16)


class Told:
    """What of it is told."""

    places = floats("n")
    tail: int = word()


DTYPE = dtype_of(Block, n=5)


def lines_of(kind: type, dtype: np.dtype[np.void], path: str = "") -> list[str]:
    """Paths of the fields that are to begin a cache line, of all elements of arrays."""
    found = []
    for name, column in columns_of(kind):
        here = f"{path}.{name}".lstrip(".")
        found += [here] * column.own_line
        if columns_of(column.item):
            array = dtype[name].shape
            for place in [f"{here}[{k}]" for k in range(array[0])] if array else [here]:
                found += lines_of(column.item, dtype[name].base, place)
    return found


def test_fields_follow_each_other_in_their_order_and_without_gaps_but_for_lines() -> None:
    at = [offset_of(DTYPE, name) for name in ("head", "tail", "ring", "places", "grid", "name")]
    assert at == [0, 64, 72, 120, 160, 240]
    assert DTYPE.itemsize == 256
    assert offset_of(DTYPE, "ring[2].second") == 72 + 2 * 16 + 8


@pytest.mark.parametrize(
    ("kind", "dtype", "some"),
    [
        (BoardMemory, BOARD_MEMORY, {"lanes[2].tail", "lanes[1].ring", "shown.image", "facts"}),
        (ServoMemory, servo_dtype(6), {"guardian", "command", "published.state", "queue.tail", "journal"}),
        (ServoMemory, servo_dtype(1), {"heartbeat", "results"}),
    ],
)
def test_every_field_that_is_to_begin_a_line_does(kind: type, dtype: np.dtype[np.void], some: set[str]) -> None:
    paths = lines_of(kind, dtype)
    assert some <= set(paths)
    assert not [path for path in paths if offset_of(dtype, path) % LINE_BYTES]


def test_blocks_of_the_servo_memory_with_different_writers_never_share_a_line() -> None:
    dtype = servo_dtype(6)
    lines = [offset_of(dtype, name) // LINE_BYTES for name in dtype.names or ()]
    assert len(set(lines)) == len(lines) == 10


def test_the_digest_of_a_type_tells_fields_that_change_places() -> None:
    class Swapped:
        second: int = word()
        first: int = word()

    class Real:
        first: float = floats(1)
        second: int = word()

    class Outer:
        inner = part(Pair)

    class OuterOfSwapped:
        inner = part(Swapped)

    kinds = (Pair, Swapped, Real, Outer, OuterOfSwapped)
    assert len({digest_of(dtype_of(kind)) for kind in kinds}) == len(kinds)
    assert digest_of(dtype_of(Pair)) == digest_of(np.dtype([("first", "<i8"), ("second", "<i8")]))


def test_servo_and_board_memory_are_refused_to_a_peer_with_other_fields() -> None:
    arm = f"test-{uuid.uuid4().hex[:12]}"
    with create_servo_memory(arm, "puma560", "pd", 6, 1_000_000, 64) as servo, create_board_memory(arm) as board:
        attach_servo_memory(arm).close()
        attach_board_memory(arm).close()
        servo.header.digest += 1
        board.header.digest += 1
        for attach in (attach_servo_memory, attach_board_memory):
            with pytest.raises(LinkError, match="other fields"):
                attach(arm)


def test_a_change_of_the_board_memory_raises_its_layout() -> None:
    """Programs in C compare that number alone: raise `LAYOUT` and `TRC004_LAYOUT` with each change of the fields."""
    assert (LAYOUT, digest_of(BOARD_MEMORY)) == (7, 6341051104469297908)


def test_producer_and_consumer_of_a_lane_and_two_writers_never_share_a_line() -> None:
    def line(path: str) -> int:
        return offset_of(BOARD_MEMORY, path) // LINE_BYTES

    assert len({line(f"lanes[{lane}].{word}") for lane in range(3) for word in ("head", "tail", "ring")}) == 9
    assert len({line(path) for path in ("header", "facts", "shown", "lanes", "traced", "panel", "faults")}) == 7


def test_record_and_words_are_the_same_memory() -> None:
    memory = np.zeros(100, np.int64)
    record = record_in(memory, DTYPE, 8)
    record.ring[1].second, record.grid[1, 4], record.places[0] = 7, 9, 1.5
    assert memory[8 + (72 + 24) // WORD_BYTES] == 7
    assert memory[8 + 232 // WORD_BYTES] == 9
    assert memory[8 + 15 : 8 + 16].view(np.float64) == 1.5
    memory[8] = 3
    assert record.head == 3
    assert view_words(record).size == DTYPE.itemsize // WORD_BYTES
    view_words(record.ring[2])[0] = 11
    assert record.ring[2].first == 11


def test_records_with_the_same_fields_have_one_type_and_others_have_their_own() -> None:
    """By identity: a call of a kernel compares types that are only equal field by field."""
    here, there = local_record(dtype_of(Told, n=5)), record_in(np.zeros(100, np.int64), dtype_of(Told, n=5), 8)
    assert here.dtype is there.dtype
    assert block_of(here).dtype is block_of(there).dtype
    assert local_record(dtype_of(Told, n=6)).dtype != here.dtype


@lean_kernel
def use(record: Block, target: Told) -> int:
    """Atomics on named fields, a block as words, and a copy by name."""
    store_release(record, "tail", load_acquire(record, "head") + 1)
    pair = record.ring[2]
    store_release(pair, "second", 5)
    seen = words_of(pair)
    seen[0] = 4
    copy_fields(record, target)
    return int(seen.size)


def test_kernels_take_fields_by_name() -> None:
    record, told = local_record(DTYPE), local_record(dtype_of(Told, n=5))
    record.head, record.places[:] = 41, np.arange(5.0)
    assert use(record, told) == 2
    assert (record.tail, record.ring[2].first, record.ring[2].second) == (42, 4, 5)
    assert (told.tail, told.places.tolist()) == (42, [0.0, 1.0, 2.0, 3.0, 4.0])


def test_an_unknown_size_is_an_error() -> None:
    with pytest.raises(KeyError, match="n"):
        dtype_of(Block)


def test_a_block_is_told_by_its_columns() -> None:
    assert [name for name, _ in columns_of(Pair)] == ["first", "second"]
    assert columns_of(np.int64) == []
    assert all(isinstance(column, StructureField) for _, column in columns_of(Block))
