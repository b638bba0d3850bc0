"""Board memory: the one layout through which every controller meets every board.

Process image in, ordered operation list out:

* the board side publishes the sixteen input words (offsets 0x00-0x1E) with a time stamp and a count, under a seqlock;
* a controller posts register operations into its *lane* (`hwif.lanes`); the board applies them strictly in the order
  posted, and an emulated board that catches up none before the time it was posted. A read with a side effect
  (ADC_START on revision E) is an operation too;
* every applied DAC and DISCRETE write goes into the trace ring (`hwif.trace`);
* an emulated board has an operator's panel as well: emergency stop, ARM POWER button, discrete and analogue inputs,
  lamps for the outputs, a push on each joint, faults to inject. A controller never touches it; tests, the pendant and
  a person at the command line do.

`BoardMemory` is a record (`realtime.structure`) in an array of one process (lock-step, tests) or in a `SharedMemory`
shared by several: the kernels do not know. Fields are int64; times are CLOCK_MONOTONIC nanoseconds, or virtual ones in
lock-step. Programs in C see the same (`examples/c/trc004.h`).
"""

from __future__ import annotations

from enum import IntEnum
from functools import cached_property
from typing import Any, Final

from qrobot.arrays import Words
from qrobot.config.outputs import N_ANALOG_OUTPUTS
from qrobot.errors import LinkBusy, LinkError
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_WORDS
from qrobot.hwif.registers import N_ADCS, N_ENCODERS
from qrobot.realtime.jit import lean_kernel
from qrobot.realtime.seqlock import begin_write, end_write, seqlock_read
from qrobot.realtime.shared_memory import SegmentHeader, SharedMemory
from qrobot.realtime.structure import WORD_BYTES, digest_of, dtype_of, local_record, part, record_in, word, words

LAYOUT: Final = 7  # the one thing that programs in C compare; those in Python compare `DIGEST` too


class Lane(IntEnum):
    """Senders of operations; the board drains the lanes in this order, so the guardian has the last word."""

    SERVO = 0
    TOOL = 1
    GUARDIAN = 2


N_LANES: Final = len(Lane)
LANE_CAPACITY: Final = 512  # operations
TRACE_CAPACITY: Final = 1 << 16  # writes
FAULT_SLOTS: Final = 16
HISTORY_IMAGES: Final = 256
IMAGES_TO_SHOW: Final = 2  # the image being made while operations are taken may lack them; the one after it has them
PANEL_MICRO: Final = 1_000_000  # of the panel's analogue values in their unit


class FactsBlock:
    """Facts that a board tells of itself, and its counters."""

    period_ns: int = word()  # how often the image is renewed
    joints: int = word()
    revision: int = word()  # ord("E") or ord("F")
    illegal_ops: int = word()  # operations on offsets of the wrong direction: ignored and counted [A]
    skipped: int = word()  # periods an emulated board gave up because it was too late to catch up
    now_ns: int = word()  # time of an emulated board's newest sample, shown or not
    dropped: int = word()  # operations that may never have acted: gateway without board, damaged lane
    losses: int = word()  # times a gateway lost the board behind it
    module_losses: int = word()  # times a remote module, or a sensor's interface, beside the board was lost
    slipped_ns: int = word()  # time an emulated board let pass unlived, see `hwif.arm_clock`
    taken_ns: int = word()  # when a gateway asked for the newest image, by our clock; else 0
    asked: int = word()  # number of a gateway's newest exchange, which may be under way; else 0


class ImageBlock:
    """The newest image, under a seqlock: whole or not to be had."""

    sequence: int = word()
    image: Words = words(IMAGE_WORDS, own_line=True)  # see `hwif.image`


class OperationSlot:
    """An operation as it waits in a lane, see `hwif.operations`."""

    kind: int = word()
    offset: int = word()
    value: int = word()
    counts_ns: int = word()  # the time from which it counts, 0 for at once


class LaneBlock:
    """One lane: positions count up and are never taken modulo."""

    head: int = word(own_line=True)  # the producer's: behind the newest operation posted
    forget: int = word()  # the producer's: what stands before it is void
    tail: int = word(own_line=True)  # the board's: of the oldest operation not taken
    ring: Any = part(OperationSlot, LANE_CAPACITY, own_line=True)


class TraceRow:
    """A DAC or DISCRETE write that was applied."""

    t_ns: int = word()
    lane: int = word()
    offset: int = word()
    value: int = word()


class TraceBlock:
    """The trace; the oldest rows give way."""

    head: int = word()  # rows ever written
    rows: Any = part(TraceRow, TRACE_CAPACITY, own_line=True)


class PanelBlock:
    """The operator's panel of an emulated board; zero everywhere is a healthy, untouched panel."""

    estop: int = word()  # 1: the emergency stop is pressed (a level)
    presses: int = word()  # times ARM POWER was pressed: add one to press it
    inputs: int = word()  # levels of discrete inputs 1-5 in their STATUS bits; bit 0 is the E-stop's
    outputs: int = word()  # what it shows: the outputs of the arm, output 1 in bit 0
    discrete: int = word()  # and the DISCRETE word in force, with the board's own output lines
    analog: Words = words(N_ADCS)  # microvolts at the ADC channels; those with a potentiometer ignore it
    analog_told: int = word()  # analogue outputs, 1 in bit 0, that somebody has said; the others are off
    analog_outputs: Words = words(N_ANALOG_OUTPUTS)  # and what they show, microvolts
    push: Words = words(N_ENCODERS)  # micro-N.m (micro-N for prismatic joints) somebody applies to each joint


class FaultSlot:
    """A fault injected, see `sim_board.injection`."""

    kind: int = word()
    channel: int = word()
    start_ns: int = word()
    end_ns: int = word()
    value: int = word()  # in millionths
    steps: int = word()  # of the board in which it was active
    acted: int = word()  # of the board in which that made a difference
    note: int = word()  # what the fault has to remember


class FaultsBlock:
    """Faults injected into an emulated board."""

    used: int = word()  # slots in use
    slots: Any = part(FaultSlot, FAULT_SLOTS, own_line=True)


class BoardMemory:
    """The whole of it."""

    header: Any = part(SegmentHeader)
    facts: Any = part(FactsBlock, own_line=True)
    shown: Any = part(ImageBlock, own_line=True)
    lanes: Any = part(LaneBlock, N_LANES, own_line=True)
    traced: Any = part(TraceBlock, own_line=True)
    panel: Any = part(PanelBlock, own_line=True)
    faults: Any = part(FaultsBlock, own_line=True)
    history: Any = words((HISTORY_IMAGES, IMAGE_WORDS))  # images that a slow board has taken and not shown yet; its own


BOARD_MEMORY: Final = dtype_of(BoardMemory)
N_WORDS: Final = BOARD_MEMORY.itemsize // WORD_BYTES
DIGEST: Final = digest_of(BOARD_MEMORY)


class BoardSegment(SharedMemory):
    """Board memory in a file, mapped; `memory` is the record."""

    @cached_property
    def memory(self) -> BoardMemory:
        """The board memory. Raises LinkError when the file is too short for it."""
        if self.words.size < N_WORDS:
            raise LinkError(f"shared memory {self.path.name!r} is cut off: restart the board")
        memory: BoardMemory = record_in(self.words, BOARD_MEMORY)
        return memory


def create_board_memory(arm: str) -> BoardSegment:
    """Own the board memory of `arm` (the board side). Raises LinkBusy when another board serves that arm."""
    return BoardSegment.create(f"{arm}-board", LAYOUT, N_WORDS, DIGEST)


def attach_board_memory(arm: str) -> BoardSegment:
    """Map the board memory of `arm` (a controller). Raises LinkError when no board serves it."""
    start = "the arm with `qrobot up`, or its board with `qrobot board`"
    return BoardSegment.attach(f"{arm}-board", LAYOUT, start, DIGEST)


def is_of_gateway(memory: BoardMemory) -> bool:
    """Whether the board is behind a gateway; one that has not found its board yet tells nothing of it."""
    return bool(memory.facts.asked != 0 or memory.facts.taken_ns != 0)


def command_board_memory(arm: str) -> BoardSegment:
    """Map the board memory of `arm` as its one controller, as long as the segment is open.

    Raises:
        LinkBusy: it has a controller: a servo, a program in C, a walk through the board, whoever it is served to.
        LinkError: no board serves it.
    """
    segment = attach_board_memory(arm)
    try:
        claim_board(segment, arm)
    except LinkBusy:
        segment.close()
        raise
    return segment


def claim_board(segment: BoardSegment, arm: str) -> None:
    """Be the one controller of the board of `arm`, or keep that for whoever its own process serves it to.

    Raises:
        LinkBusy: it has a controller.
    """
    try:
        segment.claim()
    except LinkBusy:
        raise LinkBusy(
            f"the board of {arm} has a controller already, a servo or another program, or is served to one "
            "(`qrobot board --serve`): end that one first"
        ) from None


def local_board_memory() -> BoardMemory:
    """Board memory inside this process: the in-process bus."""
    memory: BoardMemory = local_record(BOARD_MEMORY)
    return memory


@lean_kernel
def publish_image(memory: BoardMemory, image: Any) -> None:
    """Board side: publish `image` (int64[IMAGE_WORDS], see `hwif.image`)."""
    shown = memory.shown
    begin_write(shown)
    for i in range(IMAGE_WORDS):
        shown.image[i] = image[i]
    end_write(shown)


@lean_kernel
def fetch_image(memory: BoardMemory, image: Any) -> bool:
    """Controller side: copy the newest whole image into `image` (int64[IMAGE_WORDS]); False when none could be had."""
    return seqlock_read(memory.shown, memory.shown.image, image)


@lean_kernel
def newest_count(memory: BoardMemory) -> int:
    """Controller side: count of the image that is shown, being shown, or on its way from a gateway's board, at this
    moment: one that may know nothing of what has just been posted."""
    return int(max(memory.shown.image[IMAGE_COUNT], memory.facts.asked))
