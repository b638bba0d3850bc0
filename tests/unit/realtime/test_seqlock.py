"""The seqlock: a block is read whole or not at all, also beside a writer that never pauses."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

from qrobot.arrays import Words
from qrobot.realtime.atomics import load_acquire, store_release
from qrobot.realtime.jit import jit_disabled, kernel
from qrobot.realtime.seqlock import begin_write, end_write, seqlock_read
from qrobot.realtime.structure import dtype_of, local_record, word, words
from tests.support.patience import wait_until

N = 32


class Block:
    """Words under a seqlock, and beside them what stops the writer."""

    sequence: int = word()
    stop: int = word()
    content: Words = words(N, own_line=True)


GOOD = 100_000  # reads
TRIES = 200 if jit_disabled() else 10**12  # a writer that lost its processor inside a write fails any number of them


@kernel
def write(block: Any, source: Any) -> None:
    """Publish `source`."""
    begin_write(block)
    for i in range(N):
        block.content[i] = source[i]
    end_write(block)


@kernel
def read(block: Any, out: Any) -> bool:
    """Copy the content into `out`."""
    return seqlock_read(block, block.content, out)


@kernel
def write_until_stopped(block: Any, source: Any) -> int:
    """Publish blocks whose words are all equal, one after the other."""
    blocks = 0
    while load_acquire(block, "stop") == 0:
        blocks += 1
        for i in range(N):
            source[i] = blocks
        write(block, source)
    return blocks


@kernel
def read_many(block: Any, out: Any, wanted: int, tries: int) -> tuple[int, int, int]:
    """Number of (torn, backward, successful) reads."""
    torn, backward, good, last = 0, 0, 0, 0
    for _ in range(tries):
        if good == wanted:
            break
        if not seqlock_read(block, block.content, out):
            continue
        good += 1
        backward += out[0] < last
        last = out[0]
        for i in range(1, N):
            if out[i] != out[0]:
                torn += 1
                break
    return torn, backward, good


def fresh() -> tuple[Any, Any]:
    return local_record(dtype_of(Block)), np.zeros(N, np.int64)


def test_no_read_is_torn_or_goes_backward_beside_a_writing_thread() -> None:
    block, source = fresh()
    out = np.zeros(N, np.int64)
    block.stop = 1
    write_until_stopped(block, source)  # compiled before the clock runs
    block.stop = 0
    blocks: list[int] = []
    writer = threading.Thread(target=lambda: blocks.append(write_until_stopped(block, source)))
    writer.start()
    wait_until(lambda: block.sequence > 0, "the writer has begun")
    torn, backward, good = read_many(block, out, GOOD, TRIES)
    stop(block)
    writer.join()
    assert (torn, backward) == (0, 0)
    assert good == GOOD or jit_disabled()  # interpreter threads rarely switch outside the write
    assert blocks[0] > 0
    assert block.sequence == 2 * blocks[0]


@kernel
def stop(block: Any) -> None:
    """Intrinsics are only callable from compiled code."""
    store_release(block, "stop", 1)


def test_a_reader_gives_up_on_a_writer_that_died_inside() -> None:
    block, _ = fresh()
    block.sequence = 7
    assert not read(block, np.zeros(N, np.int64))


def test_a_new_writer_repairs_the_sequence_of_one_that_died_inside() -> None:
    block, source = fresh()
    block.sequence = 7
    source[:] = 5
    write(block, source)
    out = np.zeros(N, np.int64)
    assert block.sequence == 8
    assert read(block, out)
    np.testing.assert_array_equal(out, 5)
