"""Take one file of a log apart.

A file is a sequence of records, each with its length in front (MCAP specification, "Records"), so one that was cut
short yields every record that is whole, and a damaged one every chunk that is whole, with the places that are not. Rows
have one length: a run of them becomes one array copy.
"""

from __future__ import annotations

import contextlib
import io
import mmap
import struct
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.stream_reader import get_chunk_data_stream

from qrobot.config.kinds import kind_of_file
from qrobot.errors import LogError
from qrobot.log import law_message
from qrobot.log.damage import RECORD_HEAD, DamagedPlace, chunk_times, next_chunk, record_at
from qrobot.log.header import METADATA_NAME, LogHeader
from qrobot.log.status import LogStatus
from qrobot.log.topics import LAW_TOPIC, STATUS_TOPIC, TICK_TOPIC, later_parts
from qrobot.servo.memory.law_history import LawInForce
from qrobot.servo.memory.telemetry import ROW_VERSION, Rows, TelemetryLayout

MAGIC: Final = b"\x89MCAP0\r\n"
_MESSAGE_HEAD: Final = [
    ("opcode", "u1"),
    ("length", "<u8"),
    ("channel", "<u2"),
    ("sequence", "<u4"),
    ("log_time", "<u8"),
    ("publish_time", "<u8"),
]
_SUMMARY_START: Final = struct.Struct("<Q")  # the first field of the footer
_FOOTER_BYTES: Final = 20 + len(MAGIC)  # of its body, and what ends the file
_MESSAGE_AT: Final = np.dtype(_MESSAGE_HEAD).itemsize  # where a message's own bytes begin
# what damaged bytes make of a record; CRCValidationError and UnicodeDecodeError are ValueErrors
_DAMAGE: Final = (McapError, ValueError, KeyError, OverflowError, struct.error, zstandard.ZstdError, MemoryError)


@dataclass
class Contents:
    """Contents of one file's records, as far as they were read.

    Attributes:
        header: None as long as the file has not told whose log it is.
        rows: blocks of rows, in order.
        laws: entries of the servo's journal, in order.
        damage: places where something could not be read, in order.
        ended: the writer came to a regular end.
        layout: of the rows, as the file tells; None before it does.
    """

    header: LogHeader | None = None
    attachments: dict[str, bytes] = field(default_factory=dict)
    schemas: dict[int, records.Schema] = field(default_factory=dict)
    topics: dict[int, str] = field(default_factory=dict)
    rows: list[Rows] = field(default_factory=list)
    laws: list[LawInForce] = field(default_factory=list)
    status: LogStatus = field(default_factory=LogStatus)
    damage: list[DamagedPlace] = field(default_factory=list)
    ended: bool = False
    layout: TelemetryLayout | None = None


class PartScan:
    """One file, record by record.

    Args:
        path: of the file.

    Attributes:
        found: what was read so far; whoever takes rows out of it keeps memory small.
        at: offset of the next record, None when there is none.

    Raises:
        LogError: it cannot be read, or is no MCAP file.
    """

    def __init__(self, path: Path) -> None:
        self.found, self._data = Contents(), _map_file(path)
        self.at: int | None = len(MAGIC)

    @property
    def share(self) -> float:
        """Share of the file that was read."""
        return 1.0 if self.at is None else self.at / len(self._data)

    def step(self) -> bool:
        """Take the next record; False when there is none. Raises LogError: its rows are not those of its header."""
        if self.at is None or self.found.ended:
            return False
        self.at = _take_next(self.found, self._data, self.at)
        return True

    def take_head(self) -> None:
        """Take the header, and the files attached behind it: all that stands before the rows."""
        while self.found.header is None and self.step():
            pass
        while self._attached_next() and self.step():
            pass

    def _attached_next(self) -> bool:
        if self.at is None:
            return False
        try:
            return bool(record_at(self._data, self.at).opcode == Opcode.ATTACHMENT)
        except _DAMAGE:
            return False

    def rows_at(self, at: int) -> list[Rows]:
        """Rows, once more, of a chunk that was read, at offset `at`; none when it cannot be read any more."""
        again = replace(self.found, rows=[], laws=[], damage=[], topics=dict(self.found.topics))
        try:
            record = record_at(self._data, at)
            _take_record(again, record.opcode, record.body)
        except _DAMAGE:
            return []
        return again.rows


def header_of_part(path: Path) -> LogHeader | None:
    """The header of one file, None where it has none. Raises LogError: it cannot be read, or is no MCAP file."""
    scan = PartScan(path)
    scan.take_head()
    return scan.found.header


def scan_file(path: Path) -> Contents:
    """Contents of one file: every whole chunk of it.

    Raises LogError when it cannot be read, is no MCAP file, or its rows are not those of its header.
    """
    scan = PartScan(path)
    while scan.step():
        pass
    return scan.found


def _take_next(found: Contents, data: memoryview, at: int) -> int | None:
    """Take the record at offset `at`; where the next one begins, None when there is none."""
    try:
        record = record_at(data, at)
    except _DAMAGE:
        following = next_chunk(data, at + 1)
        closed = data[-len(MAGIC) :].tobytes() == MAGIC
        if following is not None or closed:  # else the file was cut short here
            _note_damage(found, data)
        found.ended = following is None and closed
        return following
    try:
        _take_record(found, record.opcode, record.body)
    except _DAMAGE:
        _note_damage(found, data, *chunk_times(record))
    return record.end


def _note_damage(found: Contents, data: memoryview, begin_ns: int | None = None, end_ns: int | None = None) -> None:
    """Something could not be read. What channels there are may have stood there; the summary tells it again."""
    found.damage.append(DamagedPlace(sum(block.size for block in found.rows), begin_ns, end_ns))
    if found.header is not None and TICK_TOPIC not in found.topics.values():
        with contextlib.suppress(*_DAMAGE):
            _take_summary(found, found.header.n, data)


def _take_summary(found: Contents, n: int, data: memoryview) -> None:
    """Schemas and channels that the end of a whole file repeats. Raises one of `_DAMAGE` when there is none."""
    at = int(_SUMMARY_START.unpack_from(data, len(data) - _FOOTER_BYTES)[0])
    while (record := record_at(data, at)).opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
        _take_definition(found, n, record.opcode, record.body)
        at = record.end


def parts_left(path: Path) -> list[Path]:
    """Parts from 2 on of the log `path` that are there: by their names, and their headers as far as they have one.

    A log of its own may be called like one, as run.2025.mcap beside run.mcap.
    """
    return [part for part in later_parts(path) if _is_part(part)]


def _is_part(path: Path) -> bool:
    try:
        header = header_of_part(path)
    except LogError:  # cut off, or no log at all
        return True
    return header is None or header.part == int(path.stem.rpartition(".")[2])


def is_begun(path: Path) -> bool:
    """Whether the file of a part has more than its first bytes: a full disk, or an end, may have cut it off there."""
    try:
        return path.stat().st_size > len(MAGIC)
    except OSError as error:
        raise LogError(f"cannot read the log {path}: {error.strerror}") from None


def _map_file(path: Path) -> memoryview:
    try:
        with path.open("rb") as file:
            size = file.seek(0, io.SEEK_END)
            data = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) if size else b"")
    except OSError as error:
        raise LogError(f"cannot read the log {path}: {error.strerror}") from None
    if data[: len(MAGIC)].tobytes() != MAGIC:
        kind = kind_of_file(path)
        raise LogError(f"{path} is {f'{kind.called}, not a log: {kind.wanted_at}' if kind else 'not an MCAP file'}")
    return data


def _stream(body: memoryview) -> ReadDataStream:
    return ReadDataStream(io.BytesIO(body))


def _take_record(found: Contents, opcode: int, body: memoryview) -> None:
    """A record outside of chunks."""
    if opcode == Opcode.METADATA:
        metadata = records.Metadata.read(_stream(body))
        if metadata.name == METADATA_NAME:
            found.header = LogHeader.from_metadata(metadata.metadata)
    elif opcode == Opcode.ATTACHMENT:
        attachment = records.Attachment.read(_stream(body))
        found.attachments[attachment.name] = attachment.data
    elif opcode == Opcode.CHUNK and found.header is not None:
        stream, length = get_chunk_data_stream(records.Chunk.read(_stream(body)), validate_crc=True)
        _take_chunk(found, found.header.n, stream.read(length))
    elif opcode == Opcode.DATA_END:
        found.ended = True


def _take_chunk(found: Contents, n: int, data: bytes) -> None:
    view, at = memoryview(data), 0
    while at < len(data):
        opcode, length = RECORD_HEAD.unpack_from(data, at)
        body = view[at + RECORD_HEAD.size : at + RECORD_HEAD.size + length]
        topic = found.topics[int.from_bytes(body[:2], "little")] if opcode == Opcode.MESSAGE else None
        if topic == TICK_TOPIC and found.layout is not None:
            rows = _run_of_rows(data, at, found.layout)
            found.rows.append(rows)
            at += rows.size * _row_record(found.layout).itemsize
            continue
        if topic == STATUS_TOPIC:
            found.status = LogStatus.from_bytes(body[_MESSAGE_AT - RECORD_HEAD.size :])
        elif topic == LAW_TOPIC:
            found.laws.append(law_message.from_bytes(body[_MESSAGE_AT - RECORD_HEAD.size :], n))
        else:
            _take_definition(found, n, opcode, body)
        at += RECORD_HEAD.size + length


def _take_definition(found: Contents, n: int, opcode: int, body: memoryview) -> None:
    if opcode == Opcode.SCHEMA:
        schema = records.Schema.read(_stream(body))
        found.schemas[schema.id] = schema
    elif opcode == Opcode.CHANNEL:
        _take_channel(found, n, records.Channel.read(_stream(body)))


def _take_channel(found: Contents, n: int, channel: records.Channel) -> None:
    found.topics[channel.id] = channel.topic
    if channel.topic == TICK_TOPIC:
        found.layout = _layout_of(found.schemas[channel.schema_id].data.decode(), n)


def _layout_of(definition: str, n: int) -> TelemetryLayout:
    """Layout of rows defined so, whichever version wrote them. Raises LogError when it is none of ours."""
    for version in range(ROW_VERSION, 0, -1):
        layout = TelemetryLayout(n, version)
        if _fields(definition) == _fields(layout.ros2msg()):
            return layout
    raise LogError("the rows of this log have other fields than this version knows")


def _fields(definition: str) -> list[str]:
    return [line.split("#")[0].strip() for line in definition.splitlines()]


def _row_record(layout: TelemetryLayout) -> np.dtype[Any]:
    return np.dtype([*_MESSAGE_HEAD, ("cdr", "<u4"), ("row", layout.dtype)])


def _run_of_rows(data: bytes, at: int, layout: TelemetryLayout) -> Rows:
    """The rows of all messages from offset `at` on that are like the first: same channel, same length."""
    record = _row_record(layout)
    messages = np.frombuffer(data, dtype=record, count=(len(data) - at) // record.itemsize, offset=at)
    if not messages.size or messages["length"][0] != record.itemsize - RECORD_HEAD.size:
        raise LogError("the rows of this log have another length than its header says")
    like_first = np.logical_and.reduce(
        [messages[name] == messages[name][0] for name in ("opcode", "length", "channel")]
    )
    n = messages.size if like_first.all() else int(np.argmin(like_first))
    return messages["row"][:n].copy()
