"""A card as compiled code sees it: one array of int64 words, and the accesses that make an exchange.

Its words say where the card is and what may be done with it. Behind those of a *fake* card, which the tests make
(`tests/support/fake_card.py`), there are more: a window that answers reads, and a record of every access, so that the
code of the real card can be tested without one. What stands at `CARD_KIND` is all that differs here.

An exchange reads fourteen registers (six indexes, six counts, STATUS, ADC_VALUE) and applies what was posted. Each
access takes about a microsecond on an ISA bus: 14 for the image, and eight more for six torques, DISCRETE and an index
flag, so about 22 us a cycle. ADC_START is never read for the image, because reading it starts a conversion on
revision E; on that revision ADC_MUX, ADC_START and ADC_VALUE are bytes (TRC004 vendor driver v4.3).
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from qrobot.arrays import Words
from qrobot.hwif.board_memory import LANE_CAPACITY, BoardMemory, Lane, publish_image
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_T_NS, IMAGE_WORDS, input_at
from qrobot.hwif.isa.instructions import in_byte, in_word, out_byte, out_word
from qrobot.hwif.lanes import take_operation
from qrobot.hwif.operations import OP_ANALOG, OP_FIELDS, OP_OUTPUTS, OP_READ, OP_WRITE
from qrobot.hwif.registers import ADC_MUX, ADC_START, ADC_VALUE, ENC_LOAD, STATUS, WINDOW_BYTES
from qrobot.hwif.trace import trace_write
from qrobot.realtime.jit import lean_kernel

DEFAULT_BASE: Final = 0x300  # our choice: the vendor's driver takes the jumpered base as a parameter
NO_CARD, REAL_CARD, FAKE_CARD = range(3)  # what CARD_KIND says

(
    CARD_KIND,
    CARD_BASE,
    CARD_REVISION,  # ord("E") or ord("F")
    CARD_READ_ONLY,  # 1: nothing is written, and no read that acts is made
    CARD_COUNT,  # images so far
    CARD_WITHHELD,  # accesses that a read-only card would have got
    CARD_ILLEGAL,  # operations in the wrong direction: never made
) = range(7)
_OPERATION: Final = 8
_IMAGE: Final = _OPERATION + OP_FIELDS
CARD_WORDS: Final = _IMAGE + IMAGE_WORDS

# Of a fake card alone: what reads give, by offset / 2, and the record.
FAKE_WINDOW: Final = CARD_WORDS
FAKE_HEAD: Final = FAKE_WINDOW + WINDOW_BYTES // 2
FAKE_RECORD: Final = FAKE_HEAD + 1
RECORD_FIELDS: Final = 4  # OP_READ or OP_WRITE, offset, bits, value
RECORD_CAPACITY: Final = 1024
FAKE_WORDS: Final = FAKE_RECORD + RECORD_CAPACITY * RECORD_FIELDS

_REVISION_E: Final = ord("E")
_UNUSED: Final = STATUS + 2
_FIRST_LANES: Final = (int(Lane.SERVO), int(Lane.TOOL))


def make_card(kind: int, base: int = DEFAULT_BASE, revision: str = "F", read_only: bool = False) -> Words:
    """A card's words; those of `NO_CARD` make every exchange below do nothing."""
    card = np.zeros(FAKE_WORDS if kind == FAKE_CARD else CARD_WORDS, np.int64)
    card[CARD_KIND], card[CARD_BASE], card[CARD_REVISION], card[CARD_READ_ONLY] = kind, base, ord(revision), read_only
    return card


@lean_kernel
def access_bits(card: Any, offset: int) -> int:
    """Width of the access at an offset."""
    byte = offset == ADC_START or (card[CARD_REVISION] == _REVISION_E and offset in (ADC_MUX, ADC_VALUE))
    return 8 if byte else 16


@lean_kernel
def _record(card: Any, kind: int, offset: int, bits: int, value: int) -> None:
    slot = FAKE_RECORD + (card[FAKE_HEAD] % RECORD_CAPACITY) * RECORD_FIELDS
    card[slot], card[slot + 1], card[slot + 2], card[slot + 3] = kind, offset, bits, value
    card[FAKE_HEAD] += 1


@lean_kernel
def card_in(card: Any, offset: int) -> int:
    """Read the register at a byte offset, as wide as it is."""
    bits = access_bits(card, offset)
    if card[CARD_KIND] == FAKE_CARD:
        value = card[FAKE_WINDOW + offset // 2] & ((1 << bits) - 1)
        _record(card, OP_READ, offset, bits, value)
        return int(value)
    return int(in_byte(card[CARD_BASE] + offset) if bits == 8 else in_word(card[CARD_BASE] + offset))


@lean_kernel
def card_out(card: Any, offset: int, value: int) -> None:
    """Write the register at a byte offset, as wide as it is."""
    bits = access_bits(card, offset)
    if card[CARD_KIND] == FAKE_CARD:
        _record(card, OP_WRITE, offset, bits, value & ((1 << bits) - 1))
    elif bits == 8:
        out_byte(card[CARD_BASE] + offset, value)
    else:
        out_word(card[CARD_BASE] + offset, value)


@lean_kernel
def apply_to_card(card: Any, kind: int, offset: int, value: int) -> bool:
    """One operation; False when it was in the wrong direction, or withheld from a read-only card."""
    if kind in (OP_OUTPUTS, OP_ANALOG):
        return False  # for modules beside a board, which a card has not
    even = offset % 2 == 0
    reads = kind == OP_READ and even and 0 <= offset < ENC_LOAD
    if not reads and not (kind == OP_WRITE and even and ENC_LOAD <= offset < WINDOW_BYTES):
        card[CARD_ILLEGAL] += 1
        return False
    if card[CARD_READ_ONLY] != 0:
        card[CARD_WITHHELD] += 1
        return False
    if reads:
        card_in(card, offset)
    else:
        card_out(card, offset, value)
    return True


@lean_kernel
def apply_all(card: Any, operations: Any) -> None:
    """A list of operations, in order. Shape (k, OP_FIELDS)."""
    for i in range(operations.shape[0]):
        apply_to_card(card, operations[i, 0], operations[i, 1], operations[i, 2])


@lean_kernel
def read_card(card: Any, image: Any, now_ns: int) -> None:
    """The whole image, int64[IMAGE_WORDS], of the time `now_ns`."""
    for offset in range(0, ENC_LOAD, 2):
        if offset not in (ADC_START, _UNUSED):
            image[input_at(offset)] = card_in(card, offset)
    card[CARD_COUNT] += 1
    image[IMAGE_T_NS], image[IMAGE_COUNT] = now_ns, card[CARD_COUNT]


@lean_kernel
def show_card(card: Any, memory: BoardMemory, now_ns: int) -> None:
    """Publish the card's image in the board memory, before a cycle."""
    image = card[_IMAGE : _IMAGE + IMAGE_WORDS]
    read_card(card, image, now_ns)
    publish_image(memory, image)


@lean_kernel
def pour_lane(card: Any, memory: BoardMemory, lane: int, now_ns: int) -> None:
    """Apply what was posted to one lane of the board memory, in order, and trace it.

    Each lane has one process that does this: the guardian its own, whose trace follows a servo that is silent.
    """
    operation = card[_OPERATION : _OPERATION + OP_FIELDS]
    for _ in range(LANE_CAPACITY):
        if not take_operation(memory, lane, operation):
            return
        if apply_to_card(card, operation[0], operation[1], operation[2]) and operation[0] == OP_WRITE:
            trace_write(memory, now_ns, lane, operation[1], operation[2])


@lean_kernel
def serve_card(card: Any, memory: BoardMemory, now_ns: int) -> None:
    """Apply what servo and tools posted, after a cycle. The guardian's lane is the guardian's own to apply."""
    for lane in _FIRST_LANES:
        pour_lane(card, memory, lane, now_ns)
    memory.facts.illegal_ops = card[CARD_ILLEGAL]
