"""Messages between a C program and its engine: `struct message` and `enum op` of channel.h."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

VERSION: Final = 7  # of these messages; a program that was compiled for another one is refused
REFS: Final = 24
NUMBERS: Final = 64
TEXT: Final = 256  # bytes, with a zero behind them
_LAYOUT: Final = struct.Struct(f"=ii{REFS}q{NUMBERS}d{TEXT}s")
SIZE: Final = _LAYOUT.size
_BRIEF: Final = struct.Struct("=iiq")  # calls of functions, and their answers
BRIEF: Final = _BRIEF.size


class Op(IntEnum):
    """Purpose of a message: calls of the libraries below 100, answers and calls of the program's functions above.

    AGAIN is the answer to a call that has given way to another thread of the program, and is to be asked again.
    """

    HELLO = 1
    CONTROL = 2
    RELEASE = 3
    NEWTRANS = 4
    FREETRANS = 5
    MAKEPOSITION = 6
    JPOSITION = 7
    FREEPOS = 8
    MAKE = 9
    TRMULT = 10
    INVERT = 11
    MOVE = 12
    STOP = 13
    SETVEL = 14
    SETMODE = 15
    SETCONF = 16
    SAMPLE_PERIOD = 17
    SETIME = 18
    EVALFN = 19
    DISTANCE = 20
    LIMIT = 21
    COMPLY = 22
    LOCK = 23
    UPDATE = 24
    HAND = 25
    NEXT_SAMPLE = 26
    TEACH = 27
    STEPMODE = 28
    MAKEDB = 29
    GETR = 30
    SAVER = 31
    DUMPDB = 32
    ADCOPEN = 33
    ENCTOANG = 34
    ANGTOENC = 35
    OVERRIDE = 36
    PAUSE = 37
    RESUME = 38
    KEEP_PATH = 39
    KEPT = 40
    RETRACT = 41
    COLLISION = 42
    SETLOAD = 43
    ANALOG = 44
    ARCL_CALL = 50
    ARCL_WORD = 51
    MANIP_OPEN = 60
    MAKE_POSITION = 61
    MAINTAIN = 62
    TRACKING_MODE = 63
    CANCEL = 64
    POSE = 65
    REPLY = 100
    ERROR = 101
    SAY = 102
    ASK = 103
    CALL_TRANSFORM = 104
    CALL_FUNCTION = 105
    SIGNAL = 106
    CALL_ARCL = 107
    AGAIN = 108


@dataclass(frozen=True)
class CallMessage:
    """One message; each `op` knows which fields it uses.

    Attributes:
        op: an `Op`; plain int, as it was sent.
        n: a count or a small answer.
        refs: places in the shared memory, or functions of the program. At most 24.
        numbers: at most 64.
        text: at most 255 bytes; what is longer is cut.
    """

    op: int
    n: int = 0
    refs: Sequence[int] = ()
    numbers: Sequence[float] = ()
    text: str = ""

    def encode(self) -> bytes:
        """The bytes of `struct message`."""
        refs = (*self.refs, *(0,) * (REFS - len(self.refs)))
        numbers = (*self.numbers, *(0.0,) * (NUMBERS - len(self.numbers)))
        return _LAYOUT.pack(self.op, self.n, *refs, *numbers, self.text.encode()[: TEXT - 1])


def encode_call(op: Op, number: int, place: int) -> bytes:
    """The `BRIEF` bytes that have a function called."""
    return _BRIEF.pack(op, number, place)


def decode(data: bytes) -> CallMessage:
    """The message of `SIZE` bytes."""
    op, n, *rest, text = _LAYOUT.unpack(data)
    return CallMessage(op, n, rest[:REFS], rest[REFS:], text.partition(b"\0")[0].decode(errors="replace"))
