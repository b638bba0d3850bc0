"""Telemetry: one row per cycle, in a ring of shared memory that never makes the servo wait.

A row is a fixed sequence of 8-byte fields, so the same bytes are a row of the ring, a NumPy record and, behind a
four-byte header, a ROS 2 message in CDR (OMG DDS-XTYPES 7.4, plain CDR little-endian: 8-byte fields are never padded).
The ring is `words[base]`, the number of rows ever written, then from `base + 8` the rows. The writer overwrites the
oldest row; a reader that was too slow is told how many it lost and never gets a torn one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from qrobot.arrays import Bools
from qrobot.faultcodes import NO_JOINT
from qrobot.hwif.registers import N_ADCS
from qrobot.realtime.atomics import acquire_fence, load_acquire, release_fence, store_release
from qrobot.realtime.flat_record import words_of
from qrobot.realtime.jit import lean_kernel
from qrobot.wire.vocabulary import N_SIGNALS

RING_HEADER_WORDS: Final = 8  # the head has a cache line of its own
SMALLEST_RING: Final = 16  # rows; for memory that only warms kernels up
WORD_BYTES: Final = 8
READ_ROWS: Final = 4096  # rows a reader takes at a time: a second at 4 kHz, 2 MB for six joints
SOON: Final = 8  # a ring is full in a moment when so small a share of it is left
CDR_HEADER: Final = b"\x00\x01\x00\x00"
N_FORCES: Final = 6
N_PAYLOAD: Final = 10

# name, meaning
SCALARS: Final = (
    ("tick", "cycles since the servo started"),
    ("t_ns", "point of the time grid that the cycle is for, ns on the servo's clock"),
    ("late_ns", "wake-up error, ns, points of the grid that were skipped since included"),
    ("busy_ns", "computing time of the previous cycle, ns"),
    ("mode", "modecodes.Mode"),
    ("fault", "faultcodes.FaultCode, the newest event"),
    ("setpoint_seq", "sequence number of the setpoint being played"),
    ("flags", "FLAG_* bits; joints at their torque limit << 8; frames missed in a row << 16"),
)
VECTORS: Final = (
    ("q_ref", "desired position, rad or m"),
    ("v_ref", "desired velocity, rad/s or m/s"),
    ("a_ref", "desired acceleration, rad/s2 or m/s2"),
    ("q", "measured position, rad or m"),
    ("v", "estimated velocity, rad/s or m/s"),
    ("tau", "commanded torque or force, N m or N"),
)
COUNTERS: Final = (
    ("counts", "encoder counts, unwrapped"),
    ("dac", "DAC words written"),
)
# since version 2 of the row
TERMS: Final = (
    ("gravity", "torque by which the model carries the arm, N m or N; while motors give torque"),
    ("friction", "torque that the drives lose by the model, N m or N; while motors give torque"),
)
ARRAYS: Final = (
    ("volts", N_ADCS, "at the converter's channels when they were last sampled, V"),
    ("force", N_FORCES, "on the wrist's sensor in its frame: fx fy fz tx ty tz, N and N m; NaN where it is not known"),
    ("signals", N_SIGNALS, "numbers that the law in force tells, see /servo/law"),
)
LINES: Final = (
    ("inputs", "STATUS bits of the binary inputs"),
    ("outputs", "binary outputs in force, output 1 in bit 0"),
    ("event_joint", "joint, from 0, that `fault` speaks of; -1 for none"),
)
# since version 3 of the row
ADDED: Final = (
    ("program_signals", N_SIGNALS, "numbers that the program tells, NaN for none; see /servo/law"),
    (
        "payload",
        N_PAYLOAD,
        "reckoned with, in the last frame: mass, first moments, inertia (xx yy zz xy xz yz); kg, m",
    ),
)
FACTORS: Final = (("override", "the operator's speed override"),)
ROW_VERSION: Final = 3
FLAG_UNSEEN: Final = 32  # beside those of `servo.memory.published_state`, and in place of FLAG_HALTED
SOURCES: Final = {"fault": "event", "flags": "flag_word", "volts": "sensors"}  # fields of the state of another name

Rows = NDArray[Any]  # structured, one record per cycle: dtype of a `TelemetryLayout`


@dataclass(frozen=True)
class TelemetryLayout:
    """Places of the fields of a row of `n` joints, in the three views of it.

    A row of version 1, as older logs have it, ends with its COUNTERS.
    """

    n: int
    version: int = ROW_VERSION

    @cached_property
    def dtype(self) -> np.dtype[Any]:
        """NumPy record of one row; vectors have shape (n,)."""
        fields: list[Any] = [(name, "<i8") for name, _ in SCALARS]
        fields += [(name, "<f8", (self.n,)) for name, _ in VECTORS]
        fields += [(name, "<i8", (self.n,)) for name, _ in COUNTERS]
        if self.version > 1:
            fields += [(name, "<f8", (self.n,)) for name, _ in TERMS]
            fields += [(name, "<f8", (length,)) for name, length, _ in ARRAYS]
            fields += [(name, "<i8") for name, _ in LINES]
        if self.version > 2:
            fields += [(name, "<f8", (length,)) for name, length, _ in ADDED]
            fields += [(name, "<f8") for name, _ in FACTORS]
        return np.dtype(fields)

    @property
    def source_dtype(self) -> np.dtype[Any]:
        """The same with each field named as the field of the servo's state that it is copied from."""
        fields = [(SOURCES.get(name, name), self.dtype[name]) for name in self.dtype.names or ()]
        return np.dtype(fields, align=True)

    @property
    def row_words(self) -> int:
        """64-bit words of one row."""
        return self.dtype.itemsize // WORD_BYTES

    def offset(self, name: str) -> int:
        """Index of the first word of field `name`. Raises KeyError for an unknown name."""
        fields = self.dtype.fields
        assert fields is not None
        return int(fields[name][1]) // 8

    @property
    def schema_name(self) -> str:
        """ROS 2 type of the message; one type per joint count, since its arrays have fixed length."""
        return f"qrobot_msgs/msg/ServoTick{self.n}"

    def ros2msg(self) -> str:
        """ROS 2 message definition of one row."""
        lines = [f"int64 {name}  # {meaning}" for name, meaning in SCALARS]
        lines += [f"float64[{self.n}] {name}  # {meaning}" for name, meaning in VECTORS]
        lines += [f"int64[{self.n}] {name}  # {meaning}" for name, meaning in COUNTERS]
        if self.version > 1:
            lines += [f"float64[{self.n}] {name}  # {meaning}" for name, meaning in TERMS]
            lines += [f"float64[{length}] {name}  # {meaning}" for name, length, meaning in ARRAYS]
            lines += [f"int64 {name}  # {meaning}" for name, meaning in LINES]
        if self.version > 2:
            lines += [f"float64[{length}] {name}  # {meaning}" for name, length, meaning in ADDED]
            lines += [f"float64 {name}  # {meaning}" for name, meaning in FACTORS]
        return "\n".join(lines) + "\n"

    def empty(self, rows: int) -> Rows:
        """Zeroed rows, shape (rows,)."""
        return np.zeros(rows, dtype=self.dtype)

    def complete(self, rows: Rows) -> Rows:
        """Rows of another version as rows of this one, shape (m,); what they do not tell is NaN, 0, or no joint."""
        if rows.dtype == self.dtype:
            return rows
        whole = self.empty(rows.size)
        known = rows.dtype.names or ()
        for name in self.dtype.names or ():
            if name in known:
                whole[name] = rows[name]
            elif whole[name].dtype.kind == "f":
                whole[name] = np.nan
            elif name == "event_joint":
                whole[name] = NO_JOINT
        return whole


def sampled(rows: Rows) -> Bools:
    """True in cycles with a new image; in the others positions were carried on, and counts stood. Shape (r,)."""
    return np.asarray(rows["flags"] & FLAG_UNSEEN == 0)


def ring_words(row_words: int, capacity: int) -> int:
    """Size in words of a ring of `capacity` rows, its head included."""
    return RING_HEADER_WORDS + capacity * row_words


def fitting_capacity(row_words: int, wanted: int, free_bytes: int) -> int:
    """Rows of a ring that leaves half of `free_bytes` to others: `wanted`, a power of two, halved until it fits."""
    capacity = wanted
    while capacity > SMALLEST_RING and 2 * WORD_BYTES * ring_words(row_words, capacity) > free_bytes:
        capacity //= 2
    return capacity


@lean_kernel
def ring_capacity(size: int, base: int, row_words: int) -> int:
    """Rows of a ring at `base` that reaches to the end of a memory of `size` words; see `ring_words`."""
    return (size - base - RING_HEADER_WORDS) // row_words


@lean_kernel
def append_telemetry(ring: Any, row: Any) -> None:
    """Servo: append a row, a record, to a ring that takes all of `ring`."""
    words = words_of(row)
    append_row(ring, 0, ring_capacity(ring.size, 0, words.size), words.size, words)


@lean_kernel
def append_row(words: Any, base: int, capacity: int, row_words: int, row: Any) -> None:
    """Writer: append `row`, int64[row_words]; the oldest row gives way. `capacity` is a power of two.

    Base and capacity are the writer's own: those in shared memory are for readers, and anybody may have spoilt them.
    """
    head = words[base]
    slot = base + RING_HEADER_WORDS + (head & (capacity - 1)) * row_words
    release_fence()  # the head that made the overwritten row old is seen before the row changes
    for i in range(row_words):
        words[slot + i] = row[i]
    store_release(words, base, head + 1)


@lean_kernel
def head_row(words: Any, base: int) -> int:
    """Number of rows ever written."""
    return load_acquire(words, base)


@lean_kernel
def oldest_row(head: int, capacity: int) -> int:
    """Index of the oldest row that is certainly whole: the one before it may be giving way right now."""
    return max(0, head - capacity + 1)


@lean_kernel
def copy_rows(words: Any, base: int, capacity: int, row_words: int, first: int, out: Any) -> tuple[int, int]:
    """Reader: copy rows from index `first` on into `out`, int64[m, row_words].

    Returns the number of rows copied and the number lost because they were overwritten before they could be had; the
    next row to ask for is `first + copied + lost`. Both are 0 when the ring was reset meanwhile (a new servo).
    """
    head = load_acquire(words, base)
    start = max(first, oldest_row(head, capacity))
    n = min(head - start, out.shape[0])
    if n <= 0:
        return 0, 0
    for k in range(n):
        slot = base + RING_HEADER_WORDS + ((start + k) & (capacity - 1)) * row_words
        for i in range(row_words):
            out[k, i] = words[slot + i]
    acquire_fence()
    after = load_acquire(words, base)
    if after < head:
        return 0, 0
    torn = min(n, max(0, oldest_row(after, capacity) - start))
    for k in range(torn, n):
        for i in range(row_words):
            out[k - torn, i] = out[k, i]
    return n - torn, start + torn - first


class TelemetryReader:
    """Follows a ring from Python; each reader keeps its own place.

    Attributes:
        next_row: index of the next row to read.
        lost: rows overwritten before this reader got to them, since the first one that it got; a reader that comes
            when the ring is full, or will be in a moment, may begin with any row.
    """

    def __init__(self, words: NDArray[np.int64], base: int, capacity: int, n: int, from_oldest: bool = True) -> None:
        self.layout = TelemetryLayout(n)
        self._words, self._base, self._capacity = words, base, capacity
        self._raw = np.zeros((min(capacity, READ_ROWS), self.layout.row_words), dtype=np.int64)
        head = int(head_row(words, base))
        self.next_row = int(oldest_row(head, capacity)) if from_oldest else head
        self._may_begin_later = from_oldest and head > capacity - capacity // SOON
        self.lost = 0

    def read(self, max_rows: int = READ_ROWS) -> Rows:
        """New rows since the last call, oldest first, at most `max_rows` of them; a copy, shape (rows,)."""
        out, row_words = self._raw[:max_rows], self.layout.row_words
        copied, lost = copy_rows(self._words, self._base, self._capacity, row_words, self.next_row, out)
        self.next_row += copied + lost
        self.lost += 0 if self._may_begin_later else lost
        self._may_begin_later = self._may_begin_later and copied == 0
        return out[:copied].copy().view(self.layout.dtype).reshape(copied)

    @property
    def waiting(self) -> int:
        """Rows written that this reader has not asked for yet."""
        return max(0, int(head_row(self._words, self._base)) - self.next_row)
