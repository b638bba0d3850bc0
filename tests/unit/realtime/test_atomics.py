"""Undivided steps on words of several threads."""

from __future__ import annotations

import threading
from typing import Any, Final

import numpy as np

from qrobot.realtime.atomics import load_acquire, raise_by_one
from qrobot.realtime.flat_record import block_of
from qrobot.realtime.jit import jit_disabled, kernel
from qrobot.realtime.structure import dtype_of, local_record, word

TIMES: Final = 1_000 if jit_disabled() else 3_000_000
THREADS: Final = 1 if jit_disabled() else 2  # a plain access is right for one thread
BESIDE: Final = 7


class Counters:
    """Two counters."""

    first: int = word()
    second: int = word()


@kernel
def raise_word(words: Any, times: int, threads: int) -> None:
    """Raise the word in the middle, one time after the other, as soon as so many threads are there to do it."""
    raise_by_one(words, 0)
    while load_acquire(words, 0) < threads:
        pass
    for _ in range(times):
        raise_by_one(words, 1)


@kernel
def raise_field(block: Any, times: int) -> None:
    """Raise a counter by its name."""
    for _ in range(times):
        raise_by_one(block[0], "second")


def test_no_raise_is_lost_beside_another_thread() -> None:
    words = np.zeros(3, np.int64)
    raise_word(words, 0, 0)  # compiled
    words[:] = 0, BESIDE, BESIDE
    threads = [threading.Thread(target=raise_word, args=(words, TIMES, THREADS)) for _ in range(THREADS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert words.tolist() == [THREADS, BESIDE + THREADS * TIMES, BESIDE]


def test_a_field_of_a_record_is_raised_by_its_name() -> None:
    record: Any = local_record(dtype_of(Counters))
    raise_field(block_of(record), 3)
    assert (record.first, record.second) == (0, 3)
