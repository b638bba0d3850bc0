"""Interfaces of every transport to a board that is more than memory: a `Bus` at the near end, an `Endpoint` at the far.

A bus carries the same two things as the board memory (board_memory.py): register operations out, strictly in the
order given, and the whole image in. What it is made of - a socket, a CAN interface - is its own affair. `Gateway`
(gateway.py) puts a bus behind the board memory, so that servo, guardian and tools never know; a server puts an
`Endpoint` behind its protocol, so that the emulated board, or anything else with the register map, answers.

Operations are int64[k, OP_FIELDS]; an image is int64[IMAGE_WORDS]: time stamp, count, the sixteen input words.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from qrobot.arrays import Words
from qrobot.errors import ConfigError, LinkBusy, LinkError, RemoteProtocolError
from qrobot.hwif.board_memory import BoardMemory, Lane, fetch_image
from qrobot.hwif.image import IMAGE_INPUTS
from qrobot.hwif.lanes import post_operations
from qrobot.hwif.operations import (
    ALL_ANALOG,
    MASK_32,
    OP_ANALOG,
    OP_FIELDS,
    OP_OUTPUTS,
    OP_READ,
    OP_REFERENCE,
    OP_WRITE,
    put_write,
)
from qrobot.hwif.registers import (
    DAC,
    DAC_ZERO,
    DISCRETE,
    DISCRETE_HAND_RELAXED,
    DISCRETE_LINES,
    N_DACS,
    N_ENCODERS,
    SCRATCH_BITS,
    WINDOW_BYTES,
)

Operations = NDArray[np.int64]  # [k, OP_FIELDS]: kind, offset, value
REGISTER_MASK: Final = 0xFFFF
NO_OPERATIONS: Final = np.zeros((0, OP_FIELDS), np.int64)
IMAGE_TRIES: Final = 100
IMAGE_PAUSE_S: Final = 100e-6


def check_encoders(robot: str, joints: int) -> None:
    """Raise ConfigError when a robot has more joints than any board has encoder channels."""
    if joints > N_ENCODERS:
        raise ConfigError(
            f"{robot} has {joints} joints, and a board {N_ENCODERS} encoder channels: such an arm runs off line only"
        )


@dataclass(frozen=True)
class BoardFacts:
    """Facts that a board tells of itself.

    Attributes:
        revision: "E" or "F"; the converter is driven differently.
        joints: encoder channels in use.
        period_ns: how often it renews its image; 0 when it does not say.
        references: it takes where the motors are to be as well (OP_REFERENCE): its drives close their own loop.
        outputs: there are modules beside it, which take the outputs of the arm (OP_OUTPUTS, OP_ANALOG).
    """

    revision: str
    joints: int
    period_ns: int = 0
    references: bool = False
    outputs: bool = False


class Bus(Protocol):
    """Interface of the near end of a transport. One thread at a time; a context is not shared between processes."""

    @property
    def name(self) -> str:
        """Name for messages: kind and address."""

    def connect(self) -> BoardFacts:
        """Find the board; again after an error. Raises LinkError (LinkBusy when somebody else has it)."""

    def exchange(self, operations: Operations, image: Words) -> None:
        """Apply `operations` at the board in order, each at most once, then read its whole image into `image`.

        Any number of them, of both kinds, at any even offset of the window: the board, not the transport, ignores and
        counts those of the wrong direction. An exchange that raises leaves `image` as it was.

        The time stamp is the board's where the transport carries it, else the middle between asking and answer
        (CLOCK_MONOTONIC); the count is the board's, or one more at each answer of a board that has none.

        Raises:
            LinkTimeout, LinkLost: no whole answer came; whether the operations were applied is not known.
            RemoteProtocolError: the answer means nothing; likewise.
        """

    def close(self) -> None:
        """Let go of it. Never raises; may be called twice."""


class Endpoint(Protocol):
    """Far end: whatever has the board's register map."""

    def facts(self) -> BoardFacts:
        """The board's own facts. Raises LinkError when there is none."""

    def apply(self, operations: Operations) -> None:
        """Apply register operations in order. Raises LinkError when the board takes none."""

    def read_image(self, image: Words) -> None:
        """The newest whole image. Raises LinkError when there is none."""


class MemoryEndpoint:
    """A board met through its memory: the emulated one, or whatever else serves it.

    Args:
        memory: the board memory.
        lane: of the board; nobody else may post to it.
    """

    def __init__(self, memory: BoardMemory, lane: Lane = Lane.TOOL) -> None:
        self._memory, self._lane = memory, int(lane)

    def facts(self) -> BoardFacts:
        """Facts that the board has written into its memory. Raises LinkError before it has."""
        revision, joints = int(self._memory.facts.revision), int(self._memory.facts.joints)
        if not revision:
            raise LinkError("the board has not said yet what it is")
        if revision not in (ord("E"), ord("F")):
            raise LinkError(f"the board memory is damaged: {revision} is no revision of a board; restart the board")
        return BoardFacts(chr(revision), joints, int(self._memory.facts.period_ns))

    def apply(self, operations: Operations) -> None:
        """Post them to the lane, all or none. Raises LinkBusy when the board does not take what was posted before."""
        if not post_operations(self._memory, self._lane, operations, len(operations)):
            raise LinkBusy("the board takes no operations: does it still run?")

    def read_image(self, image: Words) -> None:
        """The newest whole image. Raises LinkError when none could be had."""
        for _ in range(IMAGE_TRIES):
            if fetch_image(self._memory, image):
                return
            time.sleep(IMAGE_PAUSE_S)  # the board was interrupted in the middle of publishing one
        raise LinkError("the board shows no image")


def check_image(image: Words) -> None:
    """Raises RemoteProtocolError when a word does not fit a register: what came is not the image of a board."""
    words = image[IMAGE_INPUTS:]
    if words.min() < 0 or words.max() > REGISTER_MASK:
        raise RemoteProtocolError("the board's image is garbage: a word has more than 16 bits")


def sane_operations(operations: Operations, references: bool = False) -> Operations:
    """Filter operations by sense: register accesses at an even offset of the window, and outputs.

    Values are cut to 16 bits, of analogue outputs to 32. With `references` also those that say where a motor is to be,
    32 bits each.
    """
    kind, offset = operations[:, 0], operations[:, 1]
    inside = (offset >= 0) & (offset < WINDOW_BYTES)
    access = ((kind == OP_READ) | (kind == OP_WRITE)) & (offset % 2 == 0)
    reference = (kind == OP_REFERENCE) & references
    outputs = (kind == OP_OUTPUTS) & (offset == 0)
    analog = (kind == OP_ANALOG) & (offset <= ALL_ANALOG)
    sane: Operations = operations[inside & (access | reference | outputs | analog)].copy()
    wide = (sane[:, 0] == OP_REFERENCE) | (sane[:, 0] == OP_ANALOG)
    sane[:, 2] &= np.where(wide, MASK_32, REGISTER_MASK)
    return sane


def for_the_transport(operations: Operations) -> Operations:
    """Filter the operations that go to the board: outputs are for the modules beside it."""
    transport: Operations = operations[(operations[:, 0] != OP_OUTPUTS) & (operations[:, 0] != OP_ANALOG)]
    return transport


def safe_operations(status: int, lines: int = 0) -> Operations:
    """Zero torque, no arm power, the hand relaxed; the scratch bits stay as the STATUS word shows them.

    Of the board's own output lines those of `lines`, in their bits of DISCRETE, are on.
    """
    operations = np.zeros((1 + N_DACS, OP_FIELDS), np.int64)
    n = 0
    for channel in range(N_DACS):
        n = put_write(operations, n, DAC + 2 * channel, DAC_ZERO)
    put_write(operations, n, DISCRETE, status & SCRATCH_BITS | lines & DISCRETE_LINES | DISCRETE_HAND_RELAXED)
    return operations
