"""Write one log, in one or several files, on a disk that may refuse."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

from qrobot.config import Robot
from qrobot.errors import LogError
from qrobot.fences.told_fences import ToldFences
from qrobot.log.arm_view import Point
from qrobot.log.buffered_file import BEING_WRITTEN
from qrobot.log.header import Attachment, LogHeader
from qrobot.log.mcap_file import LogPart, LogStream
from qrobot.log.mcap_scan import parts_left
from qrobot.log.status import LogStatus
from qrobot.log.topics import part_path
from qrobot.model.arm_shape import NO_TOOL
from qrobot.realtime.shared_memory import has_owner
from qrobot.servo.memory.law_history import LawInForce
from qrobot.servo.memory.telemetry import Rows
from qrobot.whole_file import probe_file


class LogWriter:
    """Writes one log in parts of at most about `max_bytes`.

    Args:
        path: file of the first part, overwritten when it exists; see `part_path` for the others.
        header: facts of the log; `part` is filled in here.
        attachments: files to carry in each part.
        max_bytes: size at which the next part begins; None for a single file.
        robot: the arm, for those who want to look at it; see `ArmView`.
        tool_m: the tip of its tool from the flange.
        fences: see `ArmView`.
        begun: called with each file that has begun.

    Raises:
        LogError: the first part cannot be opened, or an old one not be removed. Later trouble is counted in `status`.
    """

    def __init__(
        self,
        path: Path,
        header: LogHeader,
        attachments: Iterable[Attachment] = (),
        max_bytes: int | None = None,
        robot: Robot | None = None,
        tool_m: Point = NO_TOOL,
        fences: ToldFences | None = None,
        begun: Callable[[Path], object] = lambda _: None,
    ) -> None:
        self.path, self._begun = path, begun
        self._header, self._attachments, self._max_bytes = header, tuple(attachments), max_bytes
        self._stream = LogStream(header, robot, tool_m, fences)
        try:
            probe_file(path)
        except OSError as error:
            raise LogError(f"cannot write the log {path}: {error.strerror}") from None
        if has_owner(path):
            raise LogError(BEING_WRITTEN.format(path))
        _remove(parts_left(path))
        self._law: LawInForce | None = None
        self._part = self._open(1)
        self._number = 1
        self._begin_ns = self._t_ns = self._rows = self._lost = self._earlier_errors = 0
        self._last_error = ""
        self._begun(path)

    def _open(self, number: int) -> LogPart:
        header = replace(self._header, part=number)
        self._stream.begin_part()
        return LogPart(self._stream, part_path(self.path, number), header, self._attachments)

    @property
    def heading(self) -> str:
        """Place that the rows go to, for people."""
        return f"recorded in {self.path}"

    @property
    def parts(self) -> list[Path]:
        """Files written so far."""
        return [part_path(self.path, number) for number in range(1, self._number + 1)]

    @property
    def backlog(self) -> int:
        """Bytes that wait for the disk."""
        return self._part.spool.backlog

    @property
    def status(self) -> LogStatus:
        """Counts of rows written and lost."""
        errors = self._earlier_errors + self._part.spool.errors
        return LogStatus(self._t_ns, self._rows, self._lost, errors, self.backlog)

    @property
    def last_error(self) -> str:
        """The disk's last error, as text; empty when there was none."""
        return self._part.spool.last_error or self._last_error

    def append(self, rows: Rows, lost: int = 0) -> None:
        """Add rows, shape (m,), in order; `lost` is the number missing before them."""
        self._stream.log_rows(rows)
        if rows.size and not self._rows:
            self._begin_ns = int(rows["t_ns"][0])
        self._rows += rows.size
        self.count_lost(lost)
        if rows.size:
            self._t_ns = int(rows["t_ns"][-1])

    def append_law(self, law: LawInForce) -> None:
        """Add what is in force; after the first rows, since the log begins with them."""
        self._stream.log_law(law, self._begin_ns)
        self._law = law

    def count_lost(self, rows: int) -> None:
        """Note that so many rows will never come."""
        self._lost += rows

    def flush(self) -> None:
        """Give the disk everything up to here, with the status behind it; begin a new part when this one is full."""
        self._log_status()
        self._part.flush()
        if self._max_bytes is not None and self._part.spool.size >= self._max_bytes:
            self._rotate()

    def sync(self) -> None:
        """Ask the disk to keep everything given to it so far."""
        self._part.spool.sync()

    def drain(self) -> None:
        """Offer the disk what waits for it."""
        self._part.spool.drain()

    def close(self) -> None:
        """Write the last status and the summary, and end the file."""
        self._log_status()
        self._part.close()

    def _log_status(self) -> None:
        if self._rows:  # there is no time to give it before the first row
            self._stream.log_status(self.status)

    def _rotate(self) -> None:
        if self.backlog:  # the end of this part must reach the disk first
            return
        try:
            following = self._open(self._number + 1)
        except LogError as error:  # go on in this part and try again at the next flush
            self._earlier_errors += 1
            self._last_error = str(error)
            return
        self._part.close()
        self._earlier_errors += self._part.spool.errors
        self._last_error = self.last_error
        self._part = following
        self._number += 1
        self._begun(part_path(self.path, self._number))  # the part before is nobody's any more
        if self._law is not None:  # the parts before may be removed
            self._stream.log_law(self._law, self._t_ns)


def remove_log(path: Path) -> None:
    """Remove a log, if there is one, with all its parts. Raises LogError: it cannot be."""
    _remove([path, *parts_left(path)])


def _remove(parts: Iterable[Path]) -> None:
    """Parts of an earlier log of that name would be read as parts of a new one."""
    for part in parts:
        try:
            part.unlink(missing_ok=True)
        except OSError as error:
            raise LogError(f"cannot remove {part}, a part of the log to be replaced: {error.strerror}") from None
