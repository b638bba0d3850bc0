"""Process data of the board's CANopen node: eight bytes at a time, both ways.

To the node goes the *mailbox* (RPDO 1): a list of register operations, one frame after the other in the order in which
they are to act. A frame is one read of a register that acts when it is read, or writes to up to three registers in a
row; the first of a list is marked and each says how many are still to come, so that a list with a hole in it is never
begun. Nothing of a list happens before the next SYNC.

From the node come, after each SYNC, five TPDOs that are one image; the first carries the counter of that SYNC
(CiA 301, 7.2.5) and how many lists were done, so that neither an old image nor a lost list is taken for a good one.
"""

from __future__ import annotations

import struct
from typing import Final

import numpy as np

from qrobot.arrays import Words
from qrobot.errors import LocalProtocolError, RemoteProtocolError
from qrobot.hwif.bus import Operations
from qrobot.hwif.image import (
    IMAGE_ADC_VALUE,
    IMAGE_COUNT,
    IMAGE_ENC_COUNT,
    IMAGE_ENC_INDEX,
    IMAGE_STATUS,
    IMAGE_T_NS,
)
from qrobot.hwif.operations import OP_FIELDS, OP_READ, OP_WRITE
from qrobot.hwif.registers import N_ENCODERS, WINDOW_BYTES

# The predefined connection set (CiA 301, 7.3.5): service at a base, the node's number added.
NMT: Final = 0x000
SYNC: Final = 0x080
EMCY: Final = 0x080
TPDO: Final = (0x180, 0x280, 0x380, 0x480, 0x680)  # there is no fifth in the set: 0x680-0x6DF is free in it
RPDO: Final = (0x200, 0x300, 0x400, 0x500)
SDO_ANSWER: Final = 0x580
SDO_ASK: Final = 0x600
START: Final = 1  # NMT command
HEARTBEAT: Final = 0x700
MAX_NODE: Final = 0x5F  # of TPDO 5

SYNC_COUNTERS: Final = 240  # the counter of SYNC runs from 1 to here
MAX_FRAMES: Final = 256  # of one list
_RUN: Final = 3  # writes in one frame
_FIRST: Final = 0x01  # of the second byte: offsets are even
_OFFSET: Final = WINDOW_BYTES - 2
_OFFSETS: Final = range(0, WINDOW_BYTES, 2)

_MAILBOX: Final = struct.Struct("<BB3H")  # frames still to come; offset | writes << 6 | first; the values
_HEAD: Final = struct.Struct("<BBHHH")  # SYNC counter, lists done, STATUS, count of the image, ADC_VALUE
_WORDS: Final = struct.Struct("<4H")
_TIME: Final = struct.Struct("<q")

_COUNTS: Final = IMAGE_ENC_COUNT
_LATCHES: Final = IMAGE_ENC_INDEX


def encode_operations(operations: Operations) -> list[bytes]:
    """The frames of one list, in order; of a longer one each `MAX_FRAMES` are a list.

    Raises LocalProtocolError for an offset outside the board's window.
    """
    runs: list[list[int]] = []
    for kind, offset, value in operations.tolist():
        if offset not in _OFFSETS:
            raise LocalProtocolError(f"no register of the board begins at offset {offset}")
        if kind == OP_READ:
            runs.append([offset])
        elif runs and 1 < len(runs[-1]) <= _RUN and offset == runs[-1][0] + 2 * (len(runs[-1]) - 1):
            runs[-1].append(value & 0xFFFF)
        else:
            runs.append([offset, value & 0xFFFF])
    lists = [runs[first : first + MAX_FRAMES] for first in range(0, len(runs), MAX_FRAMES)]
    return [_frame(len(part) - 1 - i, run[0] | (i == 0), run[1:]) for part in lists for i, run in enumerate(part)]


def _frame(to_come: int, code: int, values: list[int]) -> bytes:
    padded = values + [0] * (_RUN - len(values))
    return _MAILBOX.pack(to_come, code | len(values) << 6, *padded)


class Mailbox:
    """The list a node has got so far.

    Attributes:
        torn: lists that had a hole or no end, and were thrown away.
    """

    def __init__(self) -> None:
        self._rows: list[tuple[int, int, int]] = []
        self._to_come: int | None = None
        self._broken = False
        self.torn = 0

    def put(self, frame: bytes) -> None:
        """Take the next frame. Raises RemoteProtocolError when it is none."""
        if len(frame) != _MAILBOX.size:
            raise RemoteProtocolError(f"a mailbox frame has 8 bytes, not {len(frame)}")
        to_come, code, *values = _MAILBOX.unpack(frame)
        follows = self._to_come is not None and to_come == self._to_come - 1
        self._broken |= bool(code & _FIRST) != (self._to_come is None) or not (code & _FIRST or follows)
        self._to_come = to_come
        if self._broken:  # without a SYNC frames may come without end
            self._rows.clear()
            return
        offset, writes = code & _OFFSET, code >> 6
        if not writes:
            self._rows.append((OP_READ, offset, 0))
        self._rows += [(OP_WRITE, offset + 2 * i, values[i]) for i in range(writes)]

    def take(self) -> Operations | None:
        """The list, whole; None when there is none, or one that is torn. It is forgotten either way."""
        rows, whole = self._rows, self._to_come == 0 and not self._broken
        self.torn += self._to_come is not None and not whole
        self._rows, self._to_come, self._broken = [], None, False
        return np.array(rows, np.int64).reshape(-1, OP_FIELDS) if whole else None


def encode_image(image: Words, counter: int, lists: int) -> list[bytes]:
    """The five TPDOs of an image."""
    words = [int(word) & 0xFFFF for word in image]
    counts, latches = words[_COUNTS : _COUNTS + N_ENCODERS], words[_LATCHES : _LATCHES + N_ENCODERS]
    status, value = words[IMAGE_STATUS], words[IMAGE_ADC_VALUE]
    encoders = counts + latches
    return [
        _HEAD.pack(counter & 0xFF, lists & 0xFF, status, words[IMAGE_COUNT], value),
        *(_WORDS.pack(*encoders[i : i + 4]) for i in range(0, 12, 4)),
        _TIME.pack(int(image[IMAGE_T_NS])),
    ]


class Collector:
    """Puts the TPDOs of one answer together.

    Args:
        counter: of the SYNC that was sent.
    """

    def __init__(self, counter: int) -> None:
        self._counter = counter
        self._parts: dict[int, bytes] = {}

    def put(self, number: int, data: bytes) -> None:
        """Take TPDO `number`, from 0. Raises RemoteProtocolError when it has not eight bytes."""
        if len(data) != _HEAD.size:
            raise RemoteProtocolError(f"TPDO {number + 1} has 8 bytes, not {len(data)}")
        if number == 0 and data[0] != self._counter:
            self._parts.clear()  # the end of an answer that came too late
        elif number == 0 or self._parts:
            self._parts[number] = data

    @property
    def whole(self) -> bool:
        """All of them are there."""
        return len(self._parts) == len(TPDO)

    @property
    def lists(self) -> int:
        """Lists of operations the node has done so far, modulo 256."""
        return self._parts[0][1]

    def fill(self, image: Words) -> None:
        """Write them into an image whose count is that of the answer before, or one set at connecting."""
        _, _, status, count, value = _HEAD.unpack(self._parts[0])
        encoders = [word for part in (1, 2, 3) for word in _WORDS.unpack(self._parts[part])]
        image[IMAGE_COUNT] += count - int(image[IMAGE_COUNT]) & 0xFFFF
        image[IMAGE_STATUS], image[IMAGE_ADC_VALUE] = status, value
        image[_COUNTS : _COUNTS + N_ENCODERS] = encoders[:N_ENCODERS]
        image[_LATCHES : _LATCHES + N_ENCODERS] = encoders[N_ENCODERS:]
        image[IMAGE_T_NS] = _TIME.unpack(self._parts[4])[0]
