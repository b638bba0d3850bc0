"""Modbus map of a board, derived from the register table.

One address space: holding registers (functions 3, 6, 16, 22, 23) and input registers (function 4) show the same words,
for function 23 writes and reads in one request but reads holding registers only. Register `a` of the window is the
board's register at byte offset `2 a` (registers.py). Numbers of more than 16 bits have their most significant word at
the lowest address; numbers with a fraction are IEEE 754 singles (Modbus application protocol V1.1b3 orders bytes within
a word this way and leaves the order of words open).

Coils are the bits of DISCRETE as last written through Modbus, discrete inputs those of STATUS, bit 0 first.
"""
# ruff: noqa: E501 (a table reads best one row to a line)

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from qrobot.arrays import Words
from qrobot.errors import RemoteProtocolError
from qrobot.hwif.bus import BoardFacts, Operations
from qrobot.hwif.operations import OP_FIELDS, OP_READ, OP_WRITE
from qrobot.hwif.registers import REGISTERS, WINDOW_BYTES, Access

MAP_VERSION: Final = 1
MAGIC: Final = 0x51524F42  # "QROB"
WORD_BITS: Final = 16
WORD_MASK: Final = 0xFFFF

# Limits of one request: Modbus application protocol V1.1b3, sections 6.3 and 6.17
MAX_READ: Final = 125
MAX_READ_WRITE: Final = 121

WINDOW: Final = 0
WINDOW_WORDS: Final = WINDOW_BYTES // 2
FIRST_WRITTEN: Final = WINDOW_WORDS // 2  # reads live in the lower half of the window, writes in the upper

IMAGE: Final = 64  # t_ns, count, the sixteen input words
_IMAGE_CODE: Final = struct.Struct(">qq16H")
IMAGE_REGISTERS: Final = _IMAGE_CODE.size // 2
APPLIED: Final = IMAGE + IMAGE_REGISTERS
CONTROL: Final = APPLIED + 1
WATCHDOG: Final = APPLIED + 2
TRIPS: Final = APPLIED + 3
REFUSED: Final = APPLIED + 4
BAD: Final = APPLIED + 5
DROPPED: Final = APPLIED + 6
AGE: Final = APPLIED + 7

IDENTITY: Final = 128
_IDENTITY_CODE: Final = struct.Struct(">IHHHI")
IDENTITY_REGISTERS: Final = _IDENTITY_CODE.size // 2

MAILBOX: Final = 160  # sequence, number of operations, then two registers each
MAILBOX_HEAD: Final = 2
OP_REGISTERS: Final = 2
MAX_OPERATIONS: Final = (MAX_READ_WRITE - MAILBOX_HEAD) // OP_REGISTERS
MAILBOX_REGISTERS: Final = MAILBOX_HEAD + OP_REGISTERS * MAX_OPERATIONS

ROBOT: Final = 512
VECTORS: Final = 544  # of a running robot: positions, velocities, torques, references, room for `MAX_JOINTS` each
MAX_JOINTS: Final = 32
VECTOR_REGISTERS: Final = 2 * MAX_JOINTS
NOBODY, YOU, ANOTHER = range(3)


@dataclass(frozen=True)
class MapRow:
    """One row of the documented map: `count` registers from `address`."""

    address: int
    count: int
    name: str
    form: str
    access: str
    meaning: str


def _window_rows() -> tuple[MapRow, ...]:
    """The board's own registers, from their table; what it leaves unused can be read, so that all can be read at
    once."""
    used = {offset for register in REGISTERS for offset in register.offsets}
    holes = sorted(set(range(0, WINDOW_BYTES, 2)) - used)
    return tuple(
        MapRow(
            r.offset // 2,
            r.count,
            r.name,
            "u16",
            "read, write" if r.access is Access.WRITE else "read",
            f"{r.meaning}; scale {r.scale}" + (f", {r.unit}" if r.unit != "-" else ""),
        )
        for r in REGISTERS
    ) + tuple(MapRow(hole // 2, 1, "UNUSED", "u16", "read", "nothing") for hole in holes)


BOARD_ROWS: Final[tuple[MapRow, ...]] = (
    *_window_rows(),
    MapRow(IMAGE, 4, "IMAGE_T_NS", "i64", "read", "time of the image: nanoseconds of the board's clock"),
    MapRow(IMAGE + 4, 4, "IMAGE_COUNT", "i64", "read", "number of the image; one that stands still is a board that stands still"),
    MapRow(IMAGE + 8, 16, "IMAGE_INPUTS", "u16", "read", "the sixteen input words of that image, as registers 0 to 15"),
    MapRow(APPLIED, 1, "APPLIED", "u16", "read", "sequence number of the newest mailbox whose operations were applied"),
    MapRow(CONTROL, 1, "CONTROL", "u16", "read", "who may write: 0 nobody yet, 1 you, 2 another client"),
    MapRow(WATCHDOG, 1, "WATCHDOG_MS", "u16", "read", "silence of the writing client after which torque and power go; 0: never"),
    MapRow(TRIPS, 1, "TRIPS", "u16", "read", "times that has happened"),
    MapRow(REFUSED, 1, "REFUSED", "u16", "read", "writes refused because another client has the control"),
    MapRow(BAD, 1, "BAD", "u16", "read", "frames and requests that meant nothing"),
    MapRow(DROPPED, 1, "DROPPED", "u16", "read", "operations that the board behind the server did not take"),
    MapRow(AGE, 1, "AGE_MS", "u16", "read", "since the count was seen to rise, at most 65535"),
    MapRow(IDENTITY, 2, "MAGIC", "u32", "read", f"{MAGIC:#010x}"),
    MapRow(IDENTITY + 2, 1, "MAP_VERSION", "u16", "read", f"{MAP_VERSION}"),
    MapRow(IDENTITY + 3, 1, "REVISION", "u16", "read", "of the board, ASCII: 69 is E, 70 is F"),
    MapRow(IDENTITY + 4, 1, "JOINTS", "u16", "read", "encoder channels in use"),
    MapRow(IDENTITY + 5, 2, "PERIOD_NS", "u32", "read", "how often the board renews its image; 0 when it does not say"),
    MapRow(MAILBOX, 1, "SEQUENCE", "u16", "read, write", "operations under the number in APPLIED are not applied again"),
    MapRow(MAILBOX + 1, 1, "OPERATIONS", "u16", "read, write", f"how many follow, at most {MAX_OPERATIONS}"),
    MapRow(MAILBOX + 2, OP_REGISTERS * MAX_OPERATIONS, "OPERATION", "2 u16", "read, write", "kind (0 read, 1 write) times 256 plus byte offset; then the value"),
)  # fmt: skip
ROBOT_ROWS: Final[tuple[MapRow, ...]] = (
    MapRow(ROBOT, 1, "MODE", "u16", "read", "of the servo, as in the list of modes"),
    MapRow(ROBOT + 1, 1, "FAULT", "u16", "read", "fault it stands in, 0 for none"),
    MapRow(ROBOT + 2, 1, "EVENT", "u16", "read", "newest event"),
    MapRow(ROBOT + 3, 1, "JOINT", "i16", "read", "joint the event is about, counted from 0; -1 (65535) where it is about none"),
    MapRow(ROBOT + 4, 1, "FLAGS", "u16", "read", "1 powered, 2 calibrated, 4 emergency stop healthy, 8 guarded, 16 at rest"),
    MapRow(ROBOT + 5, 1, "INPUTS", "u16", "read", "discrete inputs"),
    MapRow(ROBOT + 6, 1, "HAND", "u16", "read", "as commanded: 0 relaxed, 1 open, 2 closed"),
    MapRow(ROBOT + 7, 1, "N", "u16", "read", "joints"),
    MapRow(ROBOT + 8, 4, "T_NS", "i64", "read", "time of the newest cycle: nanoseconds of the robot's clock"),
    MapRow(ROBOT + 12, 4, "TICK", "i64", "read", "its number"),
    MapRow(ROBOT + 16, 1, "OUTPUTS", "u16", "read", "binary outputs in force, output 1 in bit 0"),
    MapRow(VECTORS, VECTOR_REGISTERS, "POSITION", "f32", "read", "of each joint, rad or m"),
    MapRow(VECTORS + VECTOR_REGISTERS, VECTOR_REGISTERS, "VELOCITY", "f32", "read", "rad/s or m/s"),
    MapRow(VECTORS + 2 * VECTOR_REGISTERS, VECTOR_REGISTERS, "TORQUE", "f32", "read", "commanded, N m or N"),
    MapRow(VECTORS + 3 * VECTOR_REGISTERS, VECTOR_REGISTERS, "REFERENCE", "f32", "read", "position the servo follows"),
)  # fmt: skip


def registers_of(data: bytes) -> list[int]:
    """Bytes, the most significant first, as registers."""
    return list(struct.unpack(f">{len(data) // 2}H", data))


def bytes_of(registers: Sequence[int]) -> bytes:
    """The other way round."""
    return struct.pack(f">{len(registers)}H", *registers)


def encode_image(image: Words) -> list[int]:
    """An image as IMAGE_REGISTERS registers."""
    return registers_of(_IMAGE_CODE.pack(*image.tolist()))


def decode_image(registers: Sequence[int], image: Words) -> None:
    """Decode registers into `image`. Raises RemoteProtocolError for another number of registers."""
    if len(registers) != IMAGE_REGISTERS:
        raise RemoteProtocolError(f"an image has {IMAGE_REGISTERS} registers, not {len(registers)}")
    image[:] = _IMAGE_CODE.unpack(bytes_of(registers))


def encode_identity(facts: BoardFacts) -> list[int]:
    """Encode a board's facts as IDENTITY_REGISTERS registers."""
    return registers_of(_IDENTITY_CODE.pack(MAGIC, MAP_VERSION, ord(facts.revision), facts.joints, facts.period_ns))


def decode_identity(registers: Sequence[int]) -> BoardFacts:
    """The facts. Raises RemoteProtocolError when it is no board with this map."""
    if len(registers) != IDENTITY_REGISTERS:
        raise RemoteProtocolError(f"an identity has {IDENTITY_REGISTERS} registers, not {len(registers)}")
    magic, version, revision, joints, period_ns = _IDENTITY_CODE.unpack(bytes_of(registers))
    if magic != MAGIC:
        raise RemoteProtocolError(f"no board of ours: registers {IDENTITY} and {IDENTITY + 1} are not {MAGIC:#010x}")
    if version != MAP_VERSION:
        raise RemoteProtocolError(
            f"its map has version {version}, ours {MAP_VERSION}: use the same release at both ends"
        )
    if chr(revision) not in ("E", "F"):
        raise RemoteProtocolError(f"there is no revision {chr(revision)!r} of the board")
    return BoardFacts(chr(revision), joints, period_ns)


def encode_operations(sequence: int, operations: Operations) -> list[int]:
    """A mailbox with at most MAX_OPERATIONS operations, as registers to be written at MAILBOX."""
    registers = [sequence & WORD_MASK, len(operations)]
    for kind, offset, value in operations.tolist():
        registers += [kind << 8 | offset, value & WORD_MASK]
    return registers


def decode_operations(registers: Sequence[int]) -> Operations:
    """Decode operations behind a mailbox's sequence number. Raises RemoteProtocolError when they mean nothing."""
    count, *rest = registers
    if len(rest) < OP_REGISTERS * count:
        raise RemoteProtocolError(f"{count} operations need {OP_REGISTERS * count} registers, there are {len(rest)}")
    pairs = np.array(rest[: OP_REGISTERS * count], np.int64).reshape(count, OP_REGISTERS)
    operations = np.empty((count, OP_FIELDS), np.int64)
    operations[:, 0], operations[:, 1], operations[:, 2] = pairs[:, 0] >> 8, pairs[:, 0] & 0xFF, pairs[:, 1]
    _check_operations(operations)
    return operations


def _check_operations(operations: Operations) -> None:
    kinds, offsets = operations[:, 0], operations[:, 1]
    if not np.isin(kinds, (OP_READ, OP_WRITE)).all():
        raise RemoteProtocolError("an operation is neither a read nor a write")
    if (offsets % 2).any() or (offsets >= WINDOW_BYTES).any():
        raise RemoteProtocolError("an operation is outside the window of the board, or at an odd offset")


def written(address: int, values: Sequence[int]) -> Operations:
    """Writes of the window's registers from `address` on, in the order of addresses."""
    return np.array([(OP_WRITE, 2 * (address + i), value) for i, value in enumerate(values)], np.int64)


def encode_robot(
    words: Sequence[int], t_ns: int, tick: int, outputs: int, vectors: Sequence[NDArray[np.float64]]
) -> list[int]:
    """Registers from ROBOT on.

    Args:
        words: MODE to N, as in ROBOT_ROWS.
        t_ns, tick: of the cycle.
        outputs: in force.
        vectors: positions, velocities, torques, references. Shape (n,) each, n up to MAX_JOINTS.
    """
    registers = [*(word & WORD_MASK for word in words), *registers_of(struct.pack(">qq", t_ns, tick)), outputs]
    registers += [0] * (VECTORS - ROBOT - len(registers))
    for vector in vectors:
        singles = np.zeros(MAX_JOINTS, ">f4")
        singles[: len(vector)] = vector
        registers += registers_of(singles.tobytes())
    return registers
