"""Board memory: an image published whole, operations posted all or none and taken in order, writes traced."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot.hwif.board_memory import LANE_CAPACITY, TRACE_CAPACITY, Lane, fetch_image, local_board_memory, publish_image
from qrobot.hwif.image import IMAGE_WORDS, make_image
from qrobot.hwif.lanes import discard_operations, pending_operations, post_operations, take_operation
from qrobot.hwif.operations import OP_FIELDS, OP_WRITE
from qrobot.hwif.registers import DAC, DISCRETE, ENC_LOAD
from qrobot.hwif.trace import load_head, read_trace, trace_write
from qrobot.realtime.jit import jit_disabled, kernel
from qrobot.realtime.structure import view_words
from tests.support.thorough import examples


def operations(*values: int) -> Any:
    return np.array([(OP_WRITE, DAC, value) for value in values], np.int64).reshape(-1, OP_FIELDS)


def taken(memory: Any, lane: int) -> list[int]:
    """Values of everything the board can take from a lane now."""
    out, operation = [], np.zeros(OP_FIELDS, np.int64)
    while take_operation(memory, lane, operation):
        out.append(int(operation[2]))
    return out


@kernel
def trace_writes(memory: Any, number: int, lane: int) -> None:
    for i in range(number):
        trace_write(memory, i, lane, DAC, i)


def test_an_image_comes_out_as_it_went_in() -> None:
    memory = local_board_memory()
    image = np.arange(100, 100 + IMAGE_WORDS)
    publish_image(memory, image)
    out = make_image()
    assert fetch_image(memory, out)
    np.testing.assert_array_equal(out, image)
    np.testing.assert_array_equal(memory.shown.image, image)  # and stands where the type says
    assert memory.shown.sequence == 2


def test_the_blocks_of_the_layout_do_not_overlap() -> None:
    memory = local_board_memory()
    for lane in Lane:
        post_operations(memory, lane, np.full((LANE_CAPACITY, OP_FIELDS), 10 + lane), LANE_CAPACITY)
    trace_writes(memory, TRACE_CAPACITY, Lane.TOOL)
    publish_image(memory, np.full(IMAGE_WORDS, 5))
    for name in ("panel", "faults"):
        view_words(memory[name])[:] = 9
    memory.history[:] = 9
    out = make_image()
    assert fetch_image(memory, out)
    assert (out == 5).all()
    for lane in Lane:
        assert taken(memory, lane) == [10 + lane] * LANE_CAPACITY
    assert read_trace(memory)[-1].tolist() == [TRACE_CAPACITY - 1, Lane.TOOL, DAC, TRACE_CAPACITY - 1]


@settings(max_examples=examples(30))
@given(st.lists(st.one_of(st.integers(1, LANE_CAPACITY + 3), st.integers(-LANE_CAPACITY, -1)), max_size=12))
def test_a_lane_is_a_queue_that_accepts_all_or_none(steps: list[int]) -> None:
    memory, model, count = local_board_memory(), [], 0
    operation = np.zeros(OP_FIELDS, np.int64)
    for step in steps:
        if step > 0:
            batch = list(range(count, count + step))
            accepted = post_operations(memory, Lane.TOOL, operations(*batch), step)
            assert accepted == (len(model) + step <= LANE_CAPACITY)
            model += batch if accepted else []
            count += step
        for _ in range(-step):
            assert take_operation(memory, Lane.TOOL, operation) == bool(model)
            if model:
                assert operation[2] == model.pop(0)
        assert pending_operations(memory, Lane.TOOL) == len(model)
    assert taken(memory, Lane.TOOL) == model


def test_lanes_do_not_mix() -> None:
    memory = local_board_memory()
    post_operations(memory, Lane.SERVO, operations(1, 2), 2)
    post_operations(memory, Lane.GUARDIAN, operations(3), 1)
    assert taken(memory, Lane.TOOL) == []
    assert taken(memory, Lane.GUARDIAN) == [3]
    assert taken(memory, Lane.SERVO) == [1, 2]


def test_a_restarted_controller_forgets_its_predecessors_operations_and_loses_none_of_its_own() -> None:
    memory = local_board_memory()
    post_operations(memory, Lane.SERVO, operations(1, 2, 3), 3)
    discard_operations(memory, Lane.SERVO)
    assert pending_operations(memory, Lane.SERVO) == 0
    post_operations(memory, Lane.SERVO, operations(4, 5), 2)
    assert pending_operations(memory, Lane.SERVO) == 2
    assert taken(memory, Lane.SERVO) == [4, 5]
    post_operations(memory, Lane.SERVO, operations(6), 1)
    assert taken(memory, Lane.SERVO) == [6]


def test_a_producer_that_posts_into_memory_just_zeroed_loses_that_batch_only() -> None:
    memory = local_board_memory()
    for _ in range(5):
        post_operations(memory, Lane.SERVO, operations(*range(LANE_CAPACITY)), LANE_CAPACITY)
        taken(memory, Lane.SERVO)
    stale = int(memory.lanes[Lane.SERVO].head) + 2
    view_words(memory)[:] = 0
    memory.lanes[Lane.SERVO].head = stale  # its last store comes after a new board owner zeroed everything
    assert taken(memory, Lane.SERVO) == []
    post_operations(memory, Lane.SERVO, operations(8), 1)
    assert taken(memory, Lane.SERVO) == [8]


@kernel
def post_sequence(memory: Any, lane: int, n: int) -> int:
    """Post the numbers 0..n-1 in batches of three, retrying while the lane is full; returns the retries."""
    batch = np.zeros((3, OP_FIELDS), np.int64)
    posted, retries = 0, 0
    while posted < n:
        for i in range(3):
            batch[i, 2] = posted + i
        if post_operations(memory, lane, batch, 3):
            posted += 3
        else:
            retries += 1
    return retries


@kernel
def take_sequence(memory: Any, lane: int, n: int) -> int:
    """Take n operations; returns how many came out of turn."""
    operation = np.zeros(OP_FIELDS, np.int64)
    expected, wrong = 0, 0
    while expected < n:
        if take_operation(memory, lane, operation):
            wrong += operation[2] != expected
            expected += 1
    return wrong


def test_two_threads_lose_nothing_and_keep_the_order() -> None:
    memory, n = local_board_memory(), 300 if jit_disabled() else 300_000
    post_sequence(memory, Lane.SERVO, 0)
    take_sequence(memory, Lane.SERVO, 0)
    producer = threading.Thread(target=post_sequence, args=(memory, Lane.SERVO, n))
    producer.start()
    assert take_sequence(memory, Lane.SERVO, n) == 0
    producer.join()


def test_only_dac_and_discrete_writes_are_traced() -> None:
    memory = local_board_memory()
    for offset in (DAC, DAC + 14, DISCRETE, ENC_LOAD, DISCRETE - 2):
        trace_write(memory, 1000 + offset, Lane.TOOL, offset, 5)
    rows = read_trace(memory)
    assert rows[:, 2].tolist() == [DAC, DAC + 14, DISCRETE]
    assert rows[0].tolist() == [1000 + DAC, Lane.TOOL, DAC, 5]


@pytest.mark.sampled(1)
@pytest.mark.parametrize("extra", [1, 1000])
def test_a_full_trace_keeps_the_newest_rows_in_order(extra: int) -> None:
    memory = local_board_memory()
    total = TRACE_CAPACITY + extra
    trace_writes(memory, total, Lane.TOOL)
    assert load_head(memory) == total
    times = read_trace(memory)[:, 0]
    assert times[-1] == total - 1
    assert len(times) >= TRACE_CAPACITY - 1
    assert (np.diff(times) == 1).all()
