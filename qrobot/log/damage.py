"""Find the way through a damaged MCAP file: is a record's frame sound, and where does the next whole chunk begin?

Damage may hit a record's content, which a chunk's checksum tells, or its frame, opcode and length, which would lead
astray. So a frame is believed only where the record's own lengths agree with it and no chunk begins inside. Behind a
frame that is not, the next chunk is found by how a chunk begins (MCAP specification, "Chunk"): a reader that only walks
from record to record, as the mcap package's does, ends there.
"""

from __future__ import annotations

import io
import re
import struct
from dataclasses import dataclass
from typing import Final, NamedTuple

from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode

RECORD_HEAD: Final = struct.Struct("<BQ")  # opcode, length of what follows
_CHUNK_TIMES: Final = struct.Struct("<QQ")
_CHUNK_NAME_AT: Final = 28  # in a chunk's body: behind two times, a size and a checksum
_CHUNK_NAME: Final = re.compile(rb"\x04\x00\x00\x00zstd")  # the name of its compression, as our writer chooses it
_U32, _U64 = struct.Struct("<I"), struct.Struct("<Q")
_KNOWN: Final = frozenset(Opcode)
_SELF_TELLING: Final = {Opcode.METADATA: records.Metadata, Opcode.ATTACHMENT: records.Attachment}


class Record(NamedTuple):
    """One record: what it is, its body, and where the next one begins."""

    opcode: int
    body: memoryview
    end: int


@dataclass(frozen=True)
class DamagedPlace:
    """A place in a file where records could not be read.

    Attributes:
        rows: rows of the file that were read before it.
        begin_ns, end_ns: log times of the first and last message that were there; None where that is not told.
    """

    rows: int
    begin_ns: int | None = None
    end_ns: int | None = None


def record_at(data: memoryview, at: int) -> Record:
    """The record at offset `at`. Raises ValueError when its frame cannot be believed, or the file ends within it."""
    if at + RECORD_HEAD.size > len(data):
        raise ValueError("the file ends within the head of a record")
    opcode, length = RECORD_HEAD.unpack_from(data, at)
    begin = at + RECORD_HEAD.size
    body = data[begin : begin + length]
    if opcode not in _KNOWN or len(body) != length or not _agrees(opcode, body):
        raise ValueError("the frame of a record is damaged, or the file ends within it")
    return Record(opcode, body, begin + length)


def _agrees(opcode: int, body: memoryview) -> bool:
    """True when the contents of a record are as long as its frame says."""
    if opcode == Opcode.CHUNK:
        return _chunk_length(body) == len(body)
    if opcode in _SELF_TELLING:
        stream = ReadDataStream(io.BytesIO(body))
        _SELF_TELLING[Opcode(opcode)].read(stream)
        return int(stream.count) == len(body)
    return opcode == Opcode.CHUNK_INDEX or _CHUNK_NAME.search(body) is None


def _chunk_length(body: memoryview) -> int:
    """Length of a chunk's body by its own lengths. Raises struct.error when it is too short to have some."""
    size_at: int = _CHUNK_NAME_AT + _U32.size + _U32.unpack_from(body, _CHUNK_NAME_AT)[0]
    size: int = _U64.unpack_from(body, size_at)[0]
    return size_at + _U64.size + size


def next_chunk(data: memoryview, at: int) -> int | None:
    """Offset of the first chunk from offset `at` on whose frame can be believed; None when there is none."""
    for found in _CHUNK_NAME.finditer(data, at):
        begin = found.start() - _CHUNK_NAME_AT - RECORD_HEAD.size
        if begin >= at and data[begin] == Opcode.CHUNK and _is_framed(data, begin):
            return begin
    return None


def _is_framed(data: memoryview, at: int) -> bool:
    try:
        record_at(data, at)
    except (ValueError, struct.error):
        return False
    return True


def chunk_times(record: Record) -> tuple[int, int] | tuple[None, None]:
    """Times of the first and last message of a chunk, ns; they have no checksum. Of other records none."""
    if record.opcode != Opcode.CHUNK:
        return None, None
    begin_ns, end_ns = _CHUNK_TIMES.unpack_from(record.body)
    return (begin_ns, end_ns) if begin_ns <= end_ns else (None, None)
