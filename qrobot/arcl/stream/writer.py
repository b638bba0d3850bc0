"""The writing end of a diagnostic stream. Each record is one write: a kill leaves whole records, and at most a part."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from qrobot.arcl.stream.layout import RecordKind, packed
from qrobot.arcl.stream.start import StreamStart
from qrobot.arrays import Floats
from qrobot.errors import ConfigError


class StreamWriter:
    """Writes records of one run.

    Args:
        path: of the file; one that is there is written anew.
        start: what the stream is about.

    Attributes:
        error: why the disk refused a record, empty as long as none did; later ones are not written.

    Raises:
        ConfigError: the file cannot be written.
    """

    def __init__(self, path: Path, start: StreamStart) -> None:
        try:
            self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise ConfigError(f"cannot write the stream {path}: {error.strerror}") from error
        self.error = ""
        self._path = path
        self._offset = self._previous = 0
        self._write(RecordKind.START, start.encode(), 0.0)

    def numbers(self, kind: RecordKind, values: Floats, t_ms: float) -> None:
        """A record of float64."""
        self._write(kind, np.asarray(values, dtype="<f8").tobytes(), t_ms)

    def pose(self, T: Floats, t_ms: float) -> None:
        """A CARTESIAN record of a pose, shape (4, 4), m: column by column."""
        self.numbers(RecordKind.CARTESIAN, T[:3].T.ravel(), t_ms)

    def text(self, kind: RecordKind, line: str, t_ms: float) -> None:
        """A record of text."""
        self._write(kind, line.encode(), t_ms)

    def event(self, number: int, name: str, t_ms: float) -> None:
        """An EVENT record."""
        self._write(RecordKind.EVENT, np.array([number], dtype="<f8").tobytes() + name.encode(), t_ms)

    def close(self, t_ms: float) -> None:
        """The last record, and the end; a second call does nothing."""
        if self._fd >= 0:
            self._write(RecordKind.END, b"", t_ms)
            os.close(self._fd)
            self._fd = -1

    def _write(self, kind: RecordKind, content: bytes, t_ms: float) -> None:
        if self.error or self._fd < 0:
            return
        data = packed(kind, content, self._offset, self._previous, t_ms)
        self._previous, self._offset = self._offset, self._offset + len(data)
        try:
            while data:
                data = data[os.write(self._fd, data) :]
        except OSError as error:  # a program does not lose its arm for it
            self.error = f"the stream {self._path} is not complete: {error.strerror}"
