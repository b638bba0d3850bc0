"""The layout of a diagnostic stream: headers linked both ways, each followed by a record (Corke & Kirkham, section 4).

The paper publishes no bytes, so these are ours [A]; docs/reference/arcl-stream.md tells the same. Little-endian:

    offset  bytes  field
         0      4  "ARCL"
         4      2  kind of the record
         6      2  how many bytes at its end only fill it up to a multiple of 8
         8      4  length of the record in bytes, filling included
        12      4  CRC-32 of the header without this field, and of the record
        16      8  offset of the header before, in bytes from the beginning of the file; of itself in the first
        24      8  offset of the header behind
        32      8  time, ms from the first sample, float64
        40         the record

A file is only ever appended to: what a program that was killed has left is readable up to its last whole record. A
reader skips kinds that it does not know.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import Final, NamedTuple
from zlib import crc32

MARK: Final = b"ARCL"
MAGIC: Final = b"ARCLSTRM"
VERSION: Final = 1
HEADER: Final = struct.Struct("<4sHHIIQQd")
_ALIGN: Final = 8
LARGEST_RECORD: Final = 1 << 20  # bytes; a longer one is damage


class RecordKind(IntEnum):
    """The kinds of records. Never renumber, only add."""

    START = 1  # MAGIC, version, joints, sample period; names of robot, joints' kinds, program, machine
    JOINTS = 2  # joint setpoints, float64[n], rad (m on a sliding joint)
    CARTESIAN = 3  # T6 of the setpoints: n, o, a and p, float64[12], m
    REQUEST = 4  # a motion as it was asked for, text
    EXEC = 5  # its execution begins, text
    GRIPPER = 6  # command and value, float64[2]
    OUTPUT = 7  # first line, number of lines and value, float64[3]
    EVENT = 8  # number of the event, float64; name of the motion, text
    ERROR = 9  # text
    MEASURED = 10  # measured joint positions, float64[n], as JOINTS
    END = 11  # nothing follows that belongs to this run
    ANALOG = 12  # analogue output and its volts, float64[2]


class RecordHeader(NamedTuple):
    """A header as it stands in the file; offsets in bytes from its beginning."""

    kind: int
    filling: int
    length: int
    crc: int
    previous: int
    following: int
    t_ms: float

    @property
    def content(self) -> int:
        """Length of the record without its filling."""
        return self.length - self.filling


def packed(kind: int, content: bytes, offset: int, previous: int, t_ms: float) -> bytes:
    """Header and record, to stand at `offset`."""
    filling = -len(content) % _ALIGN
    length = len(content) + filling
    body = content + bytes(filling)
    fields = (MARK, kind, filling, length, 0, previous, offset + HEADER.size + length, t_ms)
    bare = HEADER.pack(*fields)
    return HEADER.pack(*fields[:4], checksum(bare, body), *fields[5:]) + body


def checksum(header: bytes, body: bytes) -> int:
    """CRC-32 of a header, its own field taken as 0, and its record."""
    return crc32(body, crc32(header[:12] + bytes(4) + header[16:]))


def unpacked(data: bytes | memoryview, offset: int) -> RecordHeader | None:
    """The header at `offset`; None when there is no whole and sound record."""
    if len(data) - offset < HEADER.size:
        return None
    raw = bytes(data[offset : offset + HEADER.size])
    mark, *fields = HEADER.unpack(raw)
    header = RecordHeader(*fields)
    end = offset + HEADER.size + header.length
    if mark != MARK or header.length > LARGEST_RECORD or end > len(data) or header.filling > header.length:
        return None
    if header.following != end or header.crc != checksum(raw, bytes(data[end - header.length : end])):
        return None
    return header
