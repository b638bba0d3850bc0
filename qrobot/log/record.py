"""Recorder of the telemetry ring: every cycle to log files, or a count of those that were lost.

The recorder only reads the ring, so a full or hanging disk never reaches the servo: data wait in memory up to
`BACKLOG_BYTES`, then in the ring, and what the ring overwrites is counted. Time is an argument.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Final

from qrobot.config import Robot
from qrobot.errors import LogError
from qrobot.fences.told_fences import ToldFences
from qrobot.log.arm_view import Point
from qrobot.log.header import Attachment, LogHeader
from qrobot.log.live import LiveServer
from qrobot.log.status import LogStatus
from qrobot.log.writer import LogWriter
from qrobot.model.arm_shape import NO_TOOL
from qrobot.servo.memory.law_history import JournalReader, LawInForce
from qrobot.servo.memory.telemetry import READ_ROWS, Rows, TelemetryReader

FLUSH_NS: Final = 200_000_000  # what a kill -9 of the recorder can cost, and the ring has it still
SYNC_NS: Final = 1_000_000_000  # what a power cut can cost
BACKLOG_BYTES: Final = 16 << 20

RowSink = LogWriter | LiveServer  # whoever takes the rows of a servo


class LogRecorder:
    """Follows one ring and writes it down.

    Args:
        reader: of the ring.
        writer: of the log, or whoever else takes the rows.
        journal: of the laws in force; None when there is none.
    """

    def __init__(self, reader: TelemetryReader, writer: RowSink, journal: JournalReader | None = None) -> None:
        self._reader, self._writer, self._journal = reader, writer, journal
        self._lost = 0
        self._flush_at_ns = self._sync_at_ns = 0

    @property
    def status(self) -> LogStatus:
        """Counts of rows written and lost."""
        return self._writer.status

    @property
    def last_error(self) -> str:
        """The disk's last error, as text; empty when there was none."""
        return self._writer.last_error

    @property
    def backlog(self) -> int:
        """Bytes that wait for the disk; after `close`, bytes that it never took."""
        return self._writer.backlog

    def poll(self, now_ns: int) -> int:
        """Write what the ring has, flush when it is time; returns the number of rows taken."""
        taken = self._take()
        self._take_laws()
        if now_ns >= self._flush_at_ns:
            self._flush_at_ns = now_ns + FLUSH_NS
            self._offer()
        if now_ns >= self._sync_at_ns:
            self._sync_at_ns = now_ns + SYNC_NS
            self._writer.sync()
        return taken

    def close(self, drain: bool = True) -> None:
        """End the log, with what is in the ring now unless `drain` is False (the ring is another servo's now).

        Rows that a disk still full leaves in the ring are lost, and counted.
        """
        end = self._reader.next_row + self._reader.waiting  # a servo that runs on writes more, which nobody has lost
        while drain and self._reader.next_row < end and self._take():
            pass
        if drain:
            self._take_laws()
            self._writer.count_lost(max(0, end - self._reader.next_row))
        self._writer.close()

    def _offer(self) -> None:
        """Flush; a disk that is full gets no more messages to keep than it has."""
        if self._writer.backlog > BACKLOG_BYTES:
            self._writer.drain()
        else:
            self._writer.flush()

    def _take(self) -> int:
        if self._writer.backlog > BACKLOG_BYTES:
            self._writer.drain()
        if self._writer.backlog > BACKLOG_BYTES:  # let the rows wait in the ring
            return 0
        rows = self._reader.read()
        if rows.size or self._reader.lost > self._lost:
            self._writer.append(rows, self._reader.lost - self._lost)
            self._lost = self._reader.lost
        return int(rows.size)

    def _take_laws(self) -> None:
        if self._journal is not None and self._writer.status.rows:
            for law in self._journal.read():
                self._writer.append_law(law)


def write_log(
    path: Path,
    rows: Rows,
    header: LogHeader,
    attachments: Iterable[Attachment] = (),
    max_bytes: int | None = None,
    laws: Iterable[LawInForce] = (),
    robot: Robot | None = None,
    tool_m: Point = NO_TOOL,
    fences: ToldFences | None = None,
) -> list[Path]:
    """Write rows already in memory, shape (m,), and the laws they ran under; returns the files.

    With `robot` the arm can be looked at, with its tool and fences, see `ArmView`.

    Raises LogError when the disk does not take them.
    """
    writer = LogWriter(path, header, attachments, max_bytes, robot, tool_m, fences)
    for start in range(0, rows.size, READ_ROWS):
        writer.append(rows[start : start + READ_ROWS])
        writer.flush()
    for law in laws:
        writer.append_law(law)
    writer.close()
    if writer.backlog:
        raise LogError(f"the log {path} is incomplete: {writer.last_error}")
    return writer.parts
