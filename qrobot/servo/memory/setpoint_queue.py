"""The queue of setpoints in servo memory: whoever commands appends frames, the servo takes them, without locks."""

from __future__ import annotations

from functools import cache
from typing import Any, Final

import numpy as np

from qrobot.arrays import Floats, Words
from qrobot.realtime.atomics import load_acquire, store_release
from qrobot.realtime.flat_record import copy_fields
from qrobot.realtime.jit import lean_kernel
from qrobot.realtime.structure import dtype_of, floats, local_record, part, word, words

QUEUE_CAPACITY: Final = 64  # frames

POSITION_SETPOINT: Final = 1
TORQUE_SETPOINT: Final = 2


class QueuedFrame:
    """The setpoints of one sample period."""

    stream: int = word()  # the run of setpoints it belongs to
    seq: int = word()  # its number in it
    t_ns: int = word()  # when it came, on the servo's clock
    period_ns: int = word()  # the sample period
    modes: Words = words("n")  # POSITION_SETPOINT, TORQUE_SETPOINT or 0 for none. Shape (n,)
    values: Floats = floats("n")  # rad or m, N m or N. Shape (n,)


class QueueBlock:
    """The queue: positions count up and are never taken modulo."""

    head: int = word(own_line=True)  # the producer's: behind the newest frame
    tail: int = word(own_line=True)  # the consumer's: of the oldest frame
    ring: Any = part(QueuedFrame, QUEUE_CAPACITY, own_line=True)


@cache
def frame_dtype(n: int) -> np.dtype[Any]:
    """The type of a frame of `n` joints."""
    return dtype_of(QueuedFrame, n=n)


def make_frame(n: int) -> QueuedFrame:
    """A frame of `n` joints to be filled."""
    frame: QueuedFrame = local_record(frame_dtype(n))
    return frame


@lean_kernel
def push_frame(mail: Any, frame: QueuedFrame) -> bool:
    """Producer: append `frame` to the setpoint queue; False when it is full."""
    queue = mail.queue
    head = queue.head
    if head - load_acquire(queue, "tail") >= QUEUE_CAPACITY:
        return False
    copy_fields(frame, queue.ring[head % QUEUE_CAPACITY])
    store_release(queue, "head", head + 1)
    return True


@lean_kernel
def push_block(mail: Any, frame: Any) -> bool:
    """`push_frame` for a call from Python, where records come as blocks."""
    return push_frame(mail[0], frame[0])


@lean_kernel
def peek_frame(mail: Any, frame: QueuedFrame) -> bool:
    """Consumer: copy the oldest frame without removing it; False when there is none.

    A queue that cannot be - its head behind its tail, or further before it than there is room - is emptied.
    """
    queue = mail.queue
    head, tail = load_acquire(queue, "head"), queue.tail
    if not 0 < head - tail <= QUEUE_CAPACITY:
        if head != tail:
            store_release(queue, "tail", head)
        return False
    copy_fields(queue.ring[tail % QUEUE_CAPACITY], frame)
    return True


@lean_kernel
def newest_arrival_ns(mail: Any, stream: int) -> int:
    """Consumer: when the newest frame came, if it waits and is of that stream; else 0."""
    queue = mail.queue
    head = load_acquire(queue, "head")
    if not 0 < head - queue.tail <= QUEUE_CAPACITY:
        return 0
    newest = queue.ring[(head - 1) % QUEUE_CAPACITY]
    return int(newest.t_ns) if newest.stream == stream else 0


@lean_kernel
def drop_frame(mail: Any) -> None:
    """Consumer: remove the oldest frame, which `peek_frame` has shown to exist."""
    store_release(mail.queue, "tail", mail.queue.tail + 1)


@lean_kernel
def drop_all_frames(mail: Any) -> None:
    """Consumer: empty the queue."""
    store_release(mail.queue, "tail", load_acquire(mail.queue, "head"))
