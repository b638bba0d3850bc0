"""Board memory: the one layout through which every controller meets every board.

Process image in, ordered operation list out:

* the board side publishes the sixteen input words (offsets 0x00-0x1E) with a time stamp and a count, under a seqlock;
* a controller posts register operations into its *lane*, a single-producer single-consumer ring; the board applies them
  strictly in the order posted, and an emulated board that catches up none before the time it was posted. A read with a
  side effect (ADC_START on revision E) is an operation too;
* every applied DAC and DISCRETE write goes, with the board's own time stamp, into the trace ring;
* an emulated board has an operator's panel as well: emergency stop, ARM POWER button, discrete and analogue inputs,
  lamps for the outputs, a push on each joint, faults to inject. A controller never touches it; tests, the pendant and
  a person at the command line do.

The words live in a NumPy array of one process (lock-step, tests) or in a `SharedMemory` shared by several: the kernels
below do not know. All words are int64; times are CLOCK_MONOTONIC nanoseconds, or virtual ones in lock-step.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any, Final

import numpy as np

from qrobot.arrays import Words
from qrobot.errors import LinkBusy
from qrobot.hwif.registers import DAC, DISCRETE, N_ADCS, N_DACS, N_ENCODERS, N_INPUT_WORDS
from qrobot.realtime.atomics import load_acquire, store_release
from qrobot.realtime.jit import lean_kernel
from qrobot.realtime.seqlock import seqlock_read, seqlock_write
from qrobot.realtime.shared_memory import HEADER_WORDS, SharedMemory

LAYOUT: Final = 4


class Lane(IntEnum):
    """Who posts operations; the board drains the lanes in this order, so the guardian has the last word."""

    SERVO = 0
    TOOL = 1
    GUARDIAN = 2


N_LANES: Final = len(Lane)

OP_READ: Final = 0
OP_WRITE: Final = 1
OP_REFERENCE: Final = 2  # where a motor is to be, for drives that close their own loop; boards count it as illegal
OP_OUTPUTS: Final = 3  # outputs of the arm, for modules beside the board and the emulated panel; others ignore it
OP_FIELDS: Final = 3  # kind, offset, value
REFERENCE_PER_COUNT: Final = 1 << 16  # the value of a reference is a counter with a fraction; its offset is the joint

# Facts about the board, set by its side at start.
BOARD_PERIOD_NS: Final = HEADER_WORDS
BOARD_JOINTS: Final = HEADER_WORDS + 1
BOARD_REVISION: Final = HEADER_WORDS + 2  # ord("E") or ord("F")
BOARD_ILLEGAL_OPS: Final = HEADER_WORDS + 3  # operations on offsets of the wrong direction: ignored and counted [A]
BOARD_SKIPPED: Final = HEADER_WORDS + 4  # periods an emulated board gave up because it was too late to catch up
BOARD_NOW_NS: Final = HEADER_WORDS + 5  # time of an emulated board's newest sample, shown or not
BOARD_DROPPED: Final = HEADER_WORDS + 6  # operations that may never have acted: gateway without board, damaged lane
BOARD_LOSSES: Final = HEADER_WORDS + 7  # times a gateway lost the board behind it

# The image: sequence, then time stamp, count and the input words as one seqlocked block.
IMAGE_SEQ: Final = 16
IMAGE_START: Final = 24
IMAGE_T_NS: Final = 0
IMAGE_COUNT: Final = 1
IMAGE_INPUTS: Final = 2
IMAGE_WORDS: Final = IMAGE_INPUTS + N_INPUT_WORDS

# Another fact, behind the image: there was no room with the others.
BOARD_MODULE_LOSSES: Final = IMAGE_START + IMAGE_WORDS  # times a remote module beside the board was lost
BOARD_SLIPPED_NS: Final = IMAGE_START + IMAGE_WORDS + 1  # time an emulated board let pass unlived, see `arm_clock`
BOARD_TAKEN_NS: Final = IMAGE_START + IMAGE_WORDS + 2  # when a gateway asked for the newest image, by our clock; else 0

# Lanes: the producer's words (head, where to forget to) and the board's (tail) a cache line apart, then the ring.
LANE_CAPACITY: Final = 512
LANE_FIELDS: Final = OP_FIELDS + 1  # and the time from which the operation counts, 0 for at once
LONGEST_WAIT_NS: Final = 200_000_000  # an operation further ahead than this has a damaged time: it counts at once [A]
_LANE_HEAD, _LANE_FORGET, _LANE_TAIL, _LANE_RING = 0, 1, 8, 16
LANE_WORDS: Final = _LANE_RING + LANE_CAPACITY * LANE_FIELDS
LANES_START: Final = 48

# The trace of DAC and DISCRETE writes.
TRACE_CAPACITY: Final = 1 << 16
TRACE_FIELDS: Final = 4  # t_ns, lane, offset, value
TRACE_HEAD: Final = LANES_START + N_LANES * LANE_WORDS
TRACE_START: Final = TRACE_HEAD + 8

# The operator's panel of an emulated board; zero everywhere is a healthy, untouched panel.
PANEL_START: Final = TRACE_START + TRACE_CAPACITY * TRACE_FIELDS
PANEL_ESTOP: Final = PANEL_START  # 1: the emergency stop is pressed (a level)
PANEL_PRESSES: Final = PANEL_START + 1  # times ARM POWER was pressed: add one to press it
PANEL_INPUTS: Final = PANEL_START + 2  # levels of discrete inputs 1-5 in their STATUS bits; bit 0 is the E-stop's
PANEL_OUTPUTS: Final = PANEL_START + 3  # what it shows: the outputs of the arm, output 1 in bit 0
PANEL_DISCRETE: Final = PANEL_START + 4  # and the DISCRETE word in force, with the board's own output lines
PANEL_ANALOG: Final = PANEL_START + 8  # microvolts at the eight ADC channels; those with a potentiometer ignore it
PANEL_PUSH: Final = PANEL_ANALOG + N_ADCS  # micro-N.m (micro-N for prismatic joints) somebody applies to each joint
PANEL_MICRO: Final = 1_000_000
# Faults injected into it: how many slots are in use, then the slots, laid out by `sim_board.injection`.
FAULT_SLOTS: Final = 16
FAULT_FIELDS: Final = 8
PANEL_FAULTS: Final = PANEL_PUSH + N_ENCODERS
PANEL_FAULT_SLOTS: Final = PANEL_FAULTS + 1
# Images that a slow board has taken and not shown yet; its own.
HISTORY_IMAGES: Final = 256
HISTORY_START: Final = PANEL_FAULT_SLOTS + FAULT_SLOTS * FAULT_FIELDS
N_WORDS: Final = HISTORY_START + HISTORY_IMAGES * IMAGE_WORDS


def create_board_memory(arm: str) -> SharedMemory:
    """Own the board memory of `arm` (the board side). Raises LinkBusy when another board serves that arm."""
    return SharedMemory.create(f"{arm}-board", LAYOUT, N_WORDS)


def attach_board_memory(arm: str) -> SharedMemory:
    """Map the board memory of `arm` (a controller). Raises LinkError when no board serves it."""
    return SharedMemory.attach(f"{arm}-board", LAYOUT, "the arm with `qrobot up`, or its board with `qrobot board`")


def command_board_memory(arm: str) -> SharedMemory:
    """Map the board memory of `arm` as its one controller, as long as the segment is open.

    Raises:
        LinkBusy: it has a controller: a servo, a program in C, a walk through the board.
        LinkError: no board serves it.
    """
    segment = attach_board_memory(arm)
    try:
        segment.claim()
    except LinkBusy:
        segment.close()
        raise LinkBusy(
            f"the board of {arm} has a controller already, a servo or another program: end that one first"
        ) from None
    return segment


def local_board_memory() -> Words:
    """Board memory inside this process: the in-process bus."""
    return np.zeros(N_WORDS, dtype=np.int64)


@lean_kernel
def publish_image(memory: Any, image: Any) -> None:
    """Board side: publish `image` (int64[IMAGE_WORDS]: time stamp, count, input words)."""
    seqlock_write(memory, IMAGE_SEQ, IMAGE_START, image, IMAGE_WORDS)


@lean_kernel
def fetch_image(memory: Any, image: Any) -> bool:
    """Controller side: copy the newest whole image into `image` (int64[IMAGE_WORDS]); False when none could be had."""
    return seqlock_read(memory, IMAGE_SEQ, IMAGE_START, image, IMAGE_WORDS)


@lean_kernel
def put_write(operations: Any, n: int, offset: int, value: int) -> int:
    """Append a register write to a list of operations of length `n`; returns its new length."""
    operations[n, 0], operations[n, 1], operations[n, 2] = OP_WRITE, offset, value
    return n + 1


@lean_kernel
def put_read(operations: Any, n: int, offset: int) -> int:
    """Append a read whose side effect is wanted to a list of operations of length `n`; returns its new length."""
    operations[n, 0], operations[n, 1], operations[n, 2] = OP_READ, offset, 0
    return n + 1


@lean_kernel
def put_reference(operations: Any, n: int, joint: int, value: int) -> int:
    """Append where the motor of a joint is to be, in counts x REFERENCE_PER_COUNT; returns the list's new length."""
    operations[n, 0], operations[n, 1], operations[n, 2] = OP_REFERENCE, joint, value
    return n + 1


@lean_kernel
def put_outputs(operations: Any, n: int, outputs: int) -> int:
    """Append the outputs of the arm, output 1 in bit 0, to a list of operations; returns its new length."""
    operations[n, 0], operations[n, 1], operations[n, 2] = OP_OUTPUTS, 0, outputs
    return n + 1


@lean_kernel
def post_operations(memory: Any, lane: int, operations: Any, n: int, t_ns: int = 0) -> bool:
    """Controller side: append `operations[:n]` (int64[:, OP_FIELDS]) to a lane, all or none; False when it is full.

    `t_ns` is the time from which they count for a board that catches up, on the arm's clock; 0 is at once.

    A head that somebody has damaged to a negative number begins again where the board is.
    """
    base = LANES_START + lane * LANE_WORDS
    head = memory[base + _LANE_HEAD]
    tail = load_acquire(memory, base + _LANE_TAIL)
    if head < 0:
        head = max(0, tail)
        memory[BOARD_DROPPED] += 1
    if head + n - tail > LANE_CAPACITY:
        return False
    for i in range(n):
        slot = base + _LANE_RING + ((head + i) % LANE_CAPACITY) * LANE_FIELDS
        for field in range(OP_FIELDS):
            memory[slot + field] = operations[i, field]
        memory[slot + OP_FIELDS] = t_ns
    store_release(memory, base + _LANE_HEAD, head + n)
    return True


@lean_kernel
def _done_with(memory: Any, base: Any, head: Any) -> Any:
    """How far a lane whose head is at `head` is done with: taken by the board, or forgotten by whoever posts."""
    tail, forget = memory[base + _LANE_TAIL], load_acquire(memory, base + _LANE_FORGET)
    return forget if tail < forget <= head else tail


@lean_kernel
def _next_operation(memory: Any, base: Any) -> Any:
    """Position of the oldest operation the board may take, or -1.

    A lane that is out of step is taken up again where its head is: somebody damaged it, or a new board owner zeroed the
    memory under a producer that was just posting. What lay in it counts as one operation that was dropped.
    """
    head = load_acquire(memory, base + _LANE_HEAD)
    if head < 0:
        return -1  # whoever posts next puts it right
    tail = _done_with(memory, base, head)
    if 0 < head - tail <= LANE_CAPACITY:
        return tail
    if head != tail:
        memory[BOARD_DROPPED] += 1
    store_release(memory, base + _LANE_TAIL, head)
    return -1


@lean_kernel
def take_operation(memory: Any, lane: int, operation: Any) -> bool:
    """Board side: move the oldest operation of a lane into `operation` (int64[OP_FIELDS]); False when there is none."""
    base = LANES_START + lane * LANE_WORDS
    position = _next_operation(memory, base)
    if position < 0:
        return False
    slot = base + _LANE_RING + (position % LANE_CAPACITY) * LANE_FIELDS
    for field in range(OP_FIELDS):
        operation[field] = memory[slot + field]
    store_release(memory, base + _LANE_TAIL, position + 1)
    return True


@lean_kernel
def operation_is_early(memory: Any, lane: int, t_ns: int) -> bool:
    """True when the oldest operation of a lane counts from a time after `t_ns` on."""
    base = LANES_START + lane * LANE_WORDS
    position = _next_operation(memory, base)
    if position < 0:
        return False
    counts_ns = memory[base + _LANE_RING + (position % LANE_CAPACITY) * LANE_FIELDS + OP_FIELDS]
    return bool(t_ns < counts_ns <= t_ns + LONGEST_WAIT_NS)


@lean_kernel
def newest_post_ns(memory: Any) -> int:
    """Time of the newest operation in any lane, taken or not; 0 where there is none, or none with a time."""
    newest = 0
    for lane in range(N_LANES):
        base = LANES_START + lane * LANE_WORDS
        head = load_acquire(memory, base + _LANE_HEAD)
        newest = max(newest, memory[base + _LANE_RING + ((head - 1) % LANE_CAPACITY) * LANE_FIELDS + OP_FIELDS])
    return newest


def take_all_operations(memory: Words, operations: Words) -> int:
    """Board side: move what every lane holds into `operations` (int64[k, OP_FIELDS]), lane by lane, as much as fits.

    Returns:
        How many were taken.
    """
    return int(_take_lanes(memory, operations))


@lean_kernel
def _take_lanes(memory: Any, operations: Any) -> int:
    n = 0
    for lane in range(N_LANES):
        while n < operations.shape[0] and take_operation(memory, lane, operations[n]):
            n += 1
    return n


@lean_kernel
def pending_operations(memory: Any, lane: int) -> int:
    """Operations posted to a lane that the board has not applied yet."""
    base = LANES_START + lane * LANE_WORDS
    head = load_acquire(memory, base + _LANE_HEAD)
    return int(max(0, head - _done_with(memory, base, head)))


@lean_kernel
def posted_so_far(memory: Any, lane: int) -> int:
    """Position in a lane behind the newest operation posted; a memory that is made anew begins at 0 again."""
    return int(memory[LANES_START + lane * LANE_WORDS + _LANE_HEAD])


@lean_kernel
def taken_so_far(memory: Any, lane: int) -> int:
    """Position in a lane behind the newest operation that the board has taken, or that was forgotten."""
    base = LANES_START + lane * LANE_WORDS
    return int(_done_with(memory, base, load_acquire(memory, base + _LANE_HEAD)))


@lean_kernel
def discard_operations(memory: Any, lane: int) -> None:
    """Controller side after a restart: forget what a dead predecessor posted and the board has not applied.

    Safe beside a running board: at worst it is just applying one of the old operations. What is posted from now on is
    never lost, so the caller posts safe outputs right after.
    """
    base = LANES_START + lane * LANE_WORDS
    store_release(memory, base + _LANE_FORGET, memory[base + _LANE_HEAD])


@lean_kernel
def trace_write(memory: Any, t_ns: int, lane: int, offset: int, value: int) -> None:
    """Board side: record an applied DAC or DISCRETE write."""
    if offset != DISCRETE and not DAC <= offset < DAC + 2 * N_DACS:
        return
    head = memory[TRACE_HEAD]
    slot = TRACE_START + (head % TRACE_CAPACITY) * TRACE_FIELDS
    memory[slot] = t_ns
    memory[slot + 1] = lane
    memory[slot + 2] = offset
    memory[slot + 3] = value
    store_release(memory, TRACE_HEAD, head + 1)


def read_trace(memory: Words, first: int = 0) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
    """The recorded DAC and DISCRETE writes from number `first` on, oldest first.

    Shape (k, 4): t_ns, lane, offset, value.

    Takes a copy; a board that runs meanwhile may overwrite the oldest rows while they are copied, so rows that the
    writer reached during the copy are dropped.
    """
    head = int(load_head(memory))
    first = max(first, head - TRACE_CAPACITY)
    ring = memory[TRACE_START : TRACE_START + TRACE_CAPACITY * TRACE_FIELDS].reshape(TRACE_CAPACITY, TRACE_FIELDS)
    rows = ring[np.arange(first, head) % TRACE_CAPACITY].copy()
    overwritten = max(0, int(load_head(memory)) + 1 - TRACE_CAPACITY - first)  # + 1: the row just being written
    return rows[overwritten:]


@lean_kernel
def load_head(memory: Any) -> int:
    """Number of writes traced since the board started."""
    return load_acquire(memory, TRACE_HEAD)
