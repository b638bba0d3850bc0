"""The seqlock: a block is read whole or not at all, also beside a writer that never pauses."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

from qrobot.realtime.atomics import load_acquire, store_release
from qrobot.realtime.jit import jit_disabled, kernel
from qrobot.realtime.seqlock import seqlock_read, seqlock_write

SEQ, START, N = 0, 8, 32
STOP = 4
GOOD = 100_000  # reads
TRIES = 200 if jit_disabled() else 10**12  # a writer that lost its processor inside a write fails any number of them


@kernel
def write_until_stopped(words: Any, source: Any) -> int:
    """Publish blocks whose words are all equal, one after the other."""
    blocks = 0
    while load_acquire(words, STOP) == 0:
        blocks += 1
        for i in range(N):
            source[i] = blocks
        seqlock_write(words, SEQ, START, source, N)
    return blocks


@kernel
def read_many(words: Any, out: Any, wanted: int, tries: int) -> tuple[int, int, int]:
    """Number of (torn, backward, successful) reads."""
    torn, backward, good, last = 0, 0, 0, 0
    for _ in range(tries):
        if good == wanted:
            break
        if not seqlock_read(words, SEQ, START, out, N):
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
    return np.zeros(START + N, np.int64), np.zeros(N, np.int64)


def test_no_read_is_torn_or_goes_backward_beside_a_writing_thread() -> None:
    words, source = fresh()
    out = np.zeros(N, np.int64)
    words[STOP] = 1
    write_until_stopped(words, source)  # compiled before the clock runs
    words[STOP] = 0
    blocks: list[int] = []
    writer = threading.Thread(target=lambda: blocks.append(write_until_stopped(words, source)))
    writer.start()
    torn, backward, good = read_many(words, out, GOOD, TRIES)
    store_release_from_python(words, STOP, 1)
    writer.join()
    assert (torn, backward) == (0, 0)
    assert good == GOOD or jit_disabled()  # interpreter threads rarely switch outside the write
    assert blocks[0] > 0
    assert words[SEQ] == 2 * blocks[0]


@kernel
def store_release_from_python(words: Any, index: int, value: int) -> None:
    """Intrinsics are only callable from compiled code."""
    store_release(words, index, value)


def test_a_reader_gives_up_on_a_writer_that_died_inside() -> None:
    words, _ = fresh()
    words[SEQ] = 7
    assert not seqlock_read(words, SEQ, START, np.zeros(N, np.int64), N)


def test_a_new_writer_repairs_the_sequence_of_one_that_died_inside() -> None:
    words, source = fresh()
    words[SEQ] = 7
    source[:] = 5
    seqlock_write(words, SEQ, START, source, N)
    out = np.zeros(N, np.int64)
    assert words[SEQ] == 8
    assert seqlock_read(words, SEQ, START, out, N)
    np.testing.assert_array_equal(out, 5)
