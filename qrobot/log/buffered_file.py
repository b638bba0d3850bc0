"""A file that takes everything at once and gives it to the disk when the disk is ready.

The log writer must never see a full disk: a record cut short would spoil all that follows it. So it writes into memory,
and `drain` moves whole bytes to the file as far as the disk takes them. What does not fit waits; nothing is reordered,
nothing is dropped, and the file on disk is at every moment a prefix of the log.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from stat import S_ISREG
from typing import Final

from qrobot.errors import LogError, error_text
from qrobot.realtime.shared_memory import own

BEING_WRITTEN: Final = "cannot write the log {}: another recorder is writing it"


class BufferedFile:
    """Write-only, append-only file for `foxglove.open_mcap`.

    Attributes:
        errors: times the disk refused.
        last_error: what it said last, or an empty string.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise LogError(f"cannot write the log {path}: {error.strerror}") from None
        if S_ISREG(os.fstat(self._fd).st_mode):
            self._begin_anew(path)
        self.path = path
        self._pending = bytearray()
        self._position = 0
        self.errors = 0
        self.last_error = ""

    def _begin_anew(self, path: Path) -> None:
        """Own the file as long as it is open, and empty it. Raises LogError: somebody is writing it."""
        mine = True
        with suppress(OSError):  # its file system knows no locks
            mine = own(self._fd)
        if not mine:
            os.close(self._fd)
            raise LogError(BEING_WRITTEN.format(path))
        os.ftruncate(self._fd, 0)

    @property
    def size(self) -> int:
        """Bytes of the log, on disk or waiting."""
        return self._position

    @property
    def backlog(self) -> int:
        """Bytes waiting for the disk."""
        return len(self._pending)

    def write(self, data: bytes | bytearray) -> int:
        """Take all of `data`."""
        self._pending += data
        self._position += len(data)
        return len(data)

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Tell the position. Raises ValueError for a real seek: what was written stays."""
        target = self._position + offset if whence == os.SEEK_CUR else offset
        if whence == os.SEEK_END or target != self._position:
            raise ValueError("a log is only appended to")
        return self._position

    def flush(self) -> None:
        """Called by the writer; `drain` is what moves bytes."""

    def drain(self) -> None:
        """Give the disk as much of what waits as it takes."""
        try:
            while self._pending:
                written = os.write(self._fd, self._pending)
                del self._pending[:written]
        except OSError as error:
            self._refused(error)

    def sync(self) -> None:
        """Ask the disk to keep what it has through a power cut; may take long."""
        try:
            os.fdatasync(self._fd)
        except OSError as error:
            self._refused(error)

    def close(self) -> None:
        """Drain a last time and close. What the disk does not take now is lost, and `backlog` tells how much."""
        self.drain()
        os.close(self._fd)

    def _refused(self, error: OSError) -> None:
        self.errors += 1
        self.last_error = error_text(error)
