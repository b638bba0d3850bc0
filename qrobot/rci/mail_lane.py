"""Messages between two tasks: one lane of shared words for each sender of a receiver, so that no lock is needed.

    word 0  HEAD   words put in so far, by the sender
    word 1  TAIL   words taken out so far, by the receiver
    rest    messages as a ring: number of bytes, stamp, then the bytes in whole words

Neither end ever waits: a message that does not fit is not queued.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arrays import Words
from qrobot.realtime.atomics import exchange, load_acquire, store_release
from qrobot.realtime.jit import lean_kernel

LANE_WORDS: Final = 512  # [A] 4 KiB
_HEAD: Final = 0
_TAIL: Final = 1
_DATA: Final = 2
_HEADING: Final = 2  # words in front of the bytes
NO_MESSAGE: Final = (1 << 63) - 1  # the stamp of an empty lane
LARGEST_MESSAGE: Final = (LANE_WORDS - _DATA - _HEADING) * 8


@lean_kernel
def put_message(lane: Words, stamp: int, n_bytes: int, payload: Words) -> int:
    """Queue a message; returns its bytes, or 0 when there is no room."""
    capacity = lane.size - _DATA
    head = load_acquire(lane, _HEAD)
    if capacity - (head - load_acquire(lane, _TAIL)) < payload.size + _HEADING:
        return 0
    lane[_DATA + head % capacity] = n_bytes
    lane[_DATA + (head + 1) % capacity] = stamp
    for i in range(payload.size):
        lane[_DATA + (head + _HEADING + i) % capacity] = payload[i]
    store_release(lane, _HEAD, head + _HEADING + payload.size)
    return n_bytes


def has_room(lane: Words, payload: Words) -> bool:
    """True when `put_message` would queue that, now and later on: asked by the sender, for whom room but grows."""
    return bool(lane.size - _DATA - (lane[_HEAD] - lane[_TAIL]) >= payload.size + _HEADING)


@lean_kernel
def oldest_stamp(lane: Words) -> int:
    """Stamp of the oldest message, NO_MESSAGE when there is none."""
    tail = load_acquire(lane, _TAIL)
    if load_acquire(lane, _HEAD) == tail:
        return NO_MESSAGE
    capacity = lane.size - _DATA
    return int(lane[_DATA + (tail + 1) % capacity])


@lean_kernel
def take_message(lane: Words, payload: Words) -> int:
    """Take the oldest message of a lane that has one into `payload`, LANE_WORDS long; returns its bytes."""
    capacity = lane.size - _DATA
    tail = load_acquire(lane, _TAIL)
    n_bytes = int(lane[_DATA + tail % capacity])
    n_words = (n_bytes + 7) // 8
    for i in range(n_words):
        payload[i] = lane[_DATA + (tail + _HEADING + i) % capacity]
    store_release(lane, _TAIL, tail + _HEADING + n_words)
    return n_bytes


@lean_kernel
def set_word(words: Words, index: int) -> int:
    """Set a word to 1 and return what it was, in one step: who finds 0 has it."""
    return exchange(words, index, 1)


@lean_kernel
def clear_word(words: Words, index: int) -> None:
    """Set a word to 0 behind every access that stands before it."""
    store_release(words, index, 0)


def words_of(data: bytes) -> Words:
    """Bytes as whole words, filled up with zeros."""
    return np.frombuffer(data + bytes(-len(data) % 8), dtype=np.int64)


def prepare_messages() -> None:
    """Have the kernels of this file compiled or loaded: inside a control function that would keep a robot waiting."""
    lane, payload = np.zeros(LANE_WORDS, np.int64), np.zeros(LANE_WORDS, np.int64)
    put_message(lane, 0, 1, words_of(b"m"))
    oldest_stamp(lane)
    take_message(lane, payload)
    set_word(lane, 0)
    clear_word(lane, 0)
