"""Place of every byte of a packet: one table per packet, from which codec, documentation and C structs derive.

Little endian throughout. Every number is aligned to its own size, so that a C compiler lays out the same struct without
packing. Every packet ends in the CRC-32 (IEEE 802.3, as in zlib) of all its bytes before it, at a multiple of four.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from struct import Struct
from typing import Final

from qrobot.wire.robot_state import StateRow, StateTable, rows_of
from qrobot.wire.vocabulary import N_ANALOG_OUTPUTS, N_SIGNALS, SIGNAL_NAME_BYTES, Request

MAGIC: Final = b"QROB"
HEADER_BYTES: Final = 24
CRC_BYTES: Final = 4
MAX_PACKET_BYTES: Final = 4096
NAME_BYTES: Final = 64

C_TYPES: Final = {
    "B": "uint8_t",
    "H": "uint16_t",
    "h": "int16_t",
    "I": "uint32_t",
    "q": "int64_t",
    "d": "double",
    "s": "char",
    "x": "uint8_t",
}


@dataclass(frozen=True)
class Field:
    """One row: `count` numbers of the struct code `code`; "n" of them means one per joint, "rest" up to the CRC."""

    name: str
    code: str
    unit: str
    meaning: str
    count: int | str = 1

    @property
    def size(self) -> int:
        """Bytes of one number."""
        return Struct(f"<{self.code}").size

    def length(self, n: int) -> int:
        """Count of numbers for `n` joints; a rest of unknown length counts as none."""
        if self.count == "rest":
            return 0
        return n if self.count == "n" else int(self.count)


@dataclass(frozen=True)
class Layout:
    """The rows of one kind of packet, behind the header."""

    kind: int
    name: str
    sender: str
    meaning: str
    fields: tuple[Field, ...]

    def rows(self, n: int) -> Iterator[tuple[int, Field]]:
        """(offset, field) of header and payload for `n` joints."""
        offset = 0
        for field in HEADER_FIELDS + self.fields:
            yield offset, field
            offset += field.size * field.length(n)

    def size(self, n: int) -> int:
        """Bytes for `n` joints, padding and CRC included, without a rest."""
        return self.struct(n).size + CRC_BYTES

    def struct(self, n: int) -> Struct:
        """Codec of header and fixed payload for `n` joints, padded to a multiple of four; the CRC follows it."""
        return _struct(self.kind, n)


HEADER_FIELDS: Final = (
    Field("magic", "s", "-", 'the bytes "QROB"', 4),
    Field("version", "B", "-", "3; this header, HELLO and ERROR keep their layout in every version"),
    Field("kind", "B", "-", "which packet"),
    Field("length", "H", "byte", "of the whole packet, header and CRC included; at most 4096"),
    Field("seq", "I", "-", "counts sample periods; wraps (see Sequence numbers)"),
    Field("ack", "I", "-", "seq of the newest packet received from the other side; 0 before the first"),
    Field("t_ns", "q", "ns", "the sender's monotonic clock"),
)

_DROPPED: Final = Field(
    "dropped", "I", "-", "COMMANDs of this connection that were refused: repeated, out of order or invalid; wraps"
)


def state_fields(rows: tuple[StateRow, ...]) -> tuple[Field, ...]:
    """The payload of STATE for a table of the robot's state: numbers aligned to their size, vectors as they come."""
    fields, end = [Field("joints", "B", "-", "n of WELCOME")], 1
    for row in rows:
        if not row.code:
            continue  # in the header, or no business of packets
        added = [Field(row.name, row.code, row.unit, row.meaning, row.count)]
        added += [_DROPPED] if row.name == "missed_frames" else []
        for field in added:
            gap = -end % field.size
            if gap:
                fields.append(Field("reserved", "x", "-", "send 0, ignore", gap))
            fields.append(field)
            end += gap + field.size * field.length(1)
    return tuple(fields)


_REQUESTS: Final = ", ".join(f"{each.value} {str(each.name).lower().replace('_', ' ')}" for each in Request)

HELLO: Final = Layout(
    1,
    "HELLO",
    "client",
    "first packet of a client",
    (
        Field("role", "B", "-", "1 commander, 2 observer"),
        Field("flags", "B", "bits", "1 in step, see Several arms in step"),
        Field("auth_length", "H", "byte", "of auth; 0 to 1024"),
        Field("period_us", "I", "µs", "wanted sample period, 1000 to 100000; 0 takes the server's"),
        Field("robot", "s", "-", "name of the robot, UTF-8, padded with 0; an observer may leave it empty", NAME_BYTES),
        Field("program", "s", "-", "name of the client for people, UTF-8, padded with 0", NAME_BYTES),
        Field(
            "auth", "s", "-", "the token of the bridge, padded with 0 to a multiple of 4; see Who may command", "rest"
        ),
    ),
)

WELCOME: Final = Layout(
    2,
    "WELCOME",
    "server",
    "the client is accepted; STATE packets follow",
    (
        Field("role", "B", "-", "granted: 1 commander, 2 observer"),
        Field("joints", "B", "-", "n, 1 to 32"),
        Field("reserved", "x", "-", "send 0, ignore", 2),
        Field("period_us", "I", "µs", "sample period of this connection"),
        Field("robot", "s", "-", "name of the robot, UTF-8, padded with 0", NAME_BYTES),
    ),
)

COMMAND: Final = Layout(
    3,
    "COMMAND",
    "client",
    "setpoints and requests for one sample period, in answer to a STATE",
    (
        Field("joints", "B", "-", "n of WELCOME"),
        Field("hand", "B", "-", "0 relaxed, 1 open, 2 closed"),
        Field("requests", "H", "bits", _REQUESTS),
        Field("stream", "I", "-", "names one run of setpoints; after any stop the arm follows only a new one"),
        Field(
            "outputs",
            "I",
            "bits",
            "binary outputs, output 1 in bit 0; begin with what STATE says",
        ),
        Field("reserved", "x", "-", "send 0, ignore", 4),
        Field("signals", "d", "-", "numbers that the program tells, see SIGNALS; NaN for none", N_SIGNALS),
        Field("setpoint", "d", "rad, m, N·m or N", "per joint, as its mode says", "n"),
        Field("mode", "B", "-", "per joint: 0 hold, 1 position, 2 torque", "n"),
    ),
)

STATE: Final = Layout(
    4,
    "STATE",
    "server",
    "the robot at one sample; t_ns is when it was sampled, ack the newest COMMAND taken",
    state_fields(rows_of(StateTable)),
)

ERROR: Final = Layout(
    5,
    "ERROR",
    "server",
    "something is wrong with the connection (faults of the robot travel in STATE)",
    (
        Field("code", "H", "-", "see Errors"),
        Field("fatal", "B", "-", "1: the server closes the connection after this packet"),
        Field("reserved", "x", "-", "send 0, ignore"),
        Field("text", "s", "-", "one line for people, UTF-8, padded with 0 to a multiple of 4", "rest"),
    ),
)

BYE: Final = Layout(
    6,
    "BYE",
    "both",
    "orderly end; the sender closes the connection after it",
    (Field("text", "s", "-", "why, UTF-8, padded with 0 to a multiple of 4", "rest"),),
)

STOP: Final = Layout(
    7,
    "STOP",
    "client",
    "anybody, observers too, asks for a stop on the path",
    (
        Field("power_off", "B", "-", "1: take arm power away as well; 0: hold"),
        Field("reserved", "x", "-", "send 0, ignore", 3),
    ),
)

SIGNALS: Final = Layout(
    8,
    "SIGNALS",
    "client",
    "names of the numbers in the COMMANDs from now on",
    (
        Field(
            "names",
            "s",
            "-",
            "up to 8 names of 31 bytes, in the order of COMMAND's signals, a blank between two; ASCII, padded with 0",
            SIGNAL_NAME_BYTES,
        ),
    ),
)

PAYLOAD: Final = Layout(
    9,
    "PAYLOAD",
    "client",
    "what the arm carries from now on",
    (
        Field("mass", "d", "kg", "0 for nothing"),
        Field("centre", "d", "m", "its centre of mass in the frame of the flange: x y z", 3),
        Field("inertia", "d", "kg·m²", "about that centre, along the axes of the flange: xx yy zz xy xz yz", 6),
    ),
)

COLLISION: Final = Layout(
    10,
    "COLLISION",
    "client",
    "how collisions are told from now on, and what follows them",
    (
        Field("joints", "B", "-", "n of WELCOME"),
        Field("reaction", "B", "-", "after the stop: 0 hold the arm, 1 be soft for two seconds before"),
        Field("reserved", "x", "-", "send 0, ignore", 6),
        Field("threshold", "d", "N·m or N", "torque that nobody commanded; 0 for the robot file's", "n"),
    ),
)

ANALOG: Final = Layout(
    11,
    "ANALOG",
    "client",
    "what analogue outputs are to be from now on",
    (Field("volt", "d", "V", "outputs 1 to 8; NaN for one that stays as it is", N_ANALOG_OUTPUTS),),
)

LAYOUTS: Final = (HELLO, WELCOME, COMMAND, STATE, ERROR, BYE, STOP, SIGNALS, PAYLOAD, COLLISION, ANALOG)
_BY_KIND: Final = {shape.kind: shape for shape in LAYOUTS}


@cache
def _struct(kind: int, n: int) -> Struct:
    """Looked up by kind: to hash all the rows would take longer than to pack them."""
    codes = "".join(f"{field.length(n)}{field.code}" for field in HEADER_FIELDS + _BY_KIND[kind].fields)
    padding = -Struct("<" + codes).size % 4
    return Struct(f"<{codes}{padding}x")
