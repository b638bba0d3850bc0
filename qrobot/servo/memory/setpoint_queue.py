"""The queue of setpoints in servo memory: whoever commands appends frames, the servo takes them, without locks.

A frame is the stream it belongs to, its number in it, when it came, the sample period, and then of each joint what its
value is - POSITION_SETPOINT, TORQUE_SETPOINT or 0 for none - and the value, a float's bit pattern.
"""

from __future__ import annotations

from typing import Any, Final

from qrobot.realtime.atomics import load_acquire, store_release
from qrobot.realtime.jit import lean_kernel

# Words of servo memory: the producer's, the consumer's on another cache line, then the ring.
QUEUE_HEAD: Final = 64
QUEUE_TAIL: Final = 72
QUEUE_START: Final = 80
QUEUE_CAPACITY: Final = 64  # frames
FRAME_STREAM, FRAME_SEQ, FRAME_T_NS, FRAME_PERIOD_NS, FRAME_JOINTS = range(5)  # then mode[n], value[n]

POSITION_SETPOINT: Final = 1
TORQUE_SETPOINT: Final = 2


def frame_words(n: int) -> int:
    """Words of one setpoint frame of `n` joints."""
    return FRAME_JOINTS + 2 * n


def queue_end(n: int) -> int:
    """First word of servo memory behind the queue of `n` joints."""
    return QUEUE_START + QUEUE_CAPACITY * frame_words(n)


@lean_kernel
def push_frame(words: Any, frame: Any, size: int) -> bool:
    """Producer: append `frame[:size]` to the setpoint queue; False when it is full."""
    head = words[QUEUE_HEAD]
    if head - load_acquire(words, QUEUE_TAIL) >= QUEUE_CAPACITY:
        return False
    slot = QUEUE_START + (head % QUEUE_CAPACITY) * size
    for i in range(size):
        words[slot + i] = frame[i]
    store_release(words, QUEUE_HEAD, head + 1)
    return True


@lean_kernel
def peek_frame(words: Any, frame: Any, size: int) -> bool:
    """Consumer: copy the oldest frame without removing it; False when there is none.

    A queue that cannot be - its head behind its tail, or further before it than there is room - is emptied.
    """
    head, tail = load_acquire(words, QUEUE_HEAD), words[QUEUE_TAIL]
    if not 0 < head - tail <= QUEUE_CAPACITY:
        if head != tail:
            store_release(words, QUEUE_TAIL, head)
        return False
    slot = QUEUE_START + (tail % QUEUE_CAPACITY) * size
    for i in range(size):
        frame[i] = words[slot + i]
    return True


@lean_kernel
def drop_frame(words: Any) -> None:
    """Consumer: remove the oldest frame, which `peek_frame` has shown to exist."""
    store_release(words, QUEUE_TAIL, words[QUEUE_TAIL] + 1)


@lean_kernel
def drop_all_frames(words: Any) -> None:
    """Consumer: empty the queue."""
    store_release(words, QUEUE_TAIL, load_acquire(words, QUEUE_HEAD))
