"""The reading end of a diagnostic stream: every whole record up to the first damage, also of a file that is cut."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from pathlib import Path

import numpy as np

from qrobot.arcl.stream.content import content_fault
from qrobot.arcl.stream.layout import HEADER, MARK, RecordHeader, RecordKind, unpacked
from qrobot.arcl.stream.start import StreamStart, decode_start
from qrobot.arrays import Floats
from qrobot.errors import LogError


@dataclass(frozen=True)
class StreamRecord:
    """A record.

    Attributes:
        kind: a `RecordKind`; plain int, so that one of a newer program gets through.
        t_ms: its time.
        content: its bytes.
    """

    kind: int
    t_ms: float
    content: bytes

    @property
    def numbers(self) -> Floats:
        """The content as float64."""
        return np.frombuffer(self.content, dtype="<f8").astype(np.float64)

    @property
    def text(self) -> str:
        """The content as text."""
        return self.content.decode(errors="replace")


@dataclass(frozen=True)
class Stream:
    """A whole stream.

    Attributes:
        start: what it is about.
        records: in order, without the first.
        damage: where it is cut or damaged and what follows, in words; empty when it is whole.
    """

    start: StreamStart
    records: tuple[StreamRecord, ...]
    damage: str

    def of(self, kind: RecordKind) -> list[StreamRecord]:
        """The records of one kind."""
        return [record for record in self.records if record.kind == kind]

    def table(self, kind: RecordKind, width: int) -> tuple[Floats, Floats]:
        """Times in seconds (rows,) and numbers (rows, width) of the records of a kind that have so many numbers."""
        rows = [record for record in self.of(kind) if len(record.content) == 8 * width]
        times = np.array([record.t_ms for record in rows]) * 1e-3
        return times, np.array([record.numbers for record in rows]).reshape(-1, width)


def read_stream(path: Path) -> Stream:
    """Read a stream. Raises LogError: the file cannot be read, is no stream, or of another version."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror}") from error
    first = unpacked(data, 0)
    if first is None or first.kind != RecordKind.START:
        raise LogError(f"{path}: not an ARCL stream")
    start = decode_start(_content(data, 0, first), str(path))
    records, damage = _read(data, first.following, start.n)
    return Stream(start, tuple(records), damage)


def _read(data: bytes, offset: int, n: int) -> tuple[list[StreamRecord], str]:
    """The records from `offset` on, up to the first that is not whole and sound; and what is wrong with that."""
    records: list[StreamRecord] = []
    while (header := unpacked(data, offset)) is not None:
        record = StreamRecord(header.kind, header.t_ms, _content(data, offset, header))
        fault = content_fault(header.kind, record.content, n) if isfinite(header.t_ms) else "a time that is not finite"
        if fault:
            return records, f"damaged at byte {offset}: {fault}; {_behind(data, offset)}"
        records.append(record)
        offset = header.following
    if offset < len(data):
        return records, f"damaged at byte {offset}: no whole record; {_behind(data, offset)}"
    if records and records[-1].kind == RecordKind.END:
        return records, ""
    return records, f"cut short at byte {offset}: the program that wrote it did not end it; nothing follows"


def _behind(data: bytes, offset: int) -> str:
    """The words for what follows damage at `offset`."""
    following = data.find(MARK, offset + 1)
    while following >= 0:
        if unpacked(data, following) is not None:
            return f"sound records follow from byte {following} on, which are not read"
        following = data.find(MARK, following + 1)
    return f"{len(data) - offset} bytes are left, and no sound record in them"


def _content(data: bytes, offset: int, header: RecordHeader) -> bytes:
    begin = offset + HEADER.size
    return data[begin : begin + header.content]
