"""The reading end of a diagnostic stream: every whole record, also of a file that ends in the middle of one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from qrobot.arcl.stream.layout import HEADER, RecordKind, unpacked
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
        damage: what is missing at its end, in words; empty when nothing is.
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
    records = list(_records(memoryview(data)))
    if not records:
        raise LogError(f"{path}: not an ARCL stream")
    start = decode_start(records[0].content, str(path))
    whole = sum(HEADER.size + -(-len(record.content) // 8) * 8 for record in records)
    return Stream(start, tuple(records[1:]), _damage(records, len(data) - whole))


def _records(data: memoryview) -> Iterator[StreamRecord]:
    offset = 0
    while (header := unpacked(data, offset)) is not None:
        begin = offset + HEADER.size
        yield StreamRecord(header.kind, header.t_ms, bytes(data[begin : begin + header.content]))
        offset = header.following


def _damage(records: list[StreamRecord], left_over: int) -> str:
    if left_over:
        return f"{left_over} bytes at its end are no whole record"
    return "" if records[-1].kind == RecordKind.END else "the program that wrote it was cut short"
