"""Output of a process, as far as anybody reads it: the newest lines, of bounded length, and so much a second."""

from __future__ import annotations

from collections import deque
from threading import Lock
from typing import Final, NamedTuple

from qrobot.printable import printable

MOST_LINES: Final = 2000
MOST_LETTERS: Final = 400  # of a line; the rest goes into the next one
BYTES_PER_S: Final = 64_000  # [A] ten screens a second; what is beyond is counted and left out


class OutputPart(NamedTuple):
    """Lines from a number on.

    Attributes:
        first: number of the first one, from 0.
        lines: the text.
    """

    first: int
    lines: list[str]


class OutputTail:
    """Keeps the newest lines. For several threads. Instants are seconds of one clock."""

    def __init__(self) -> None:
        self._lines: deque[str] = deque(maxlen=MOST_LINES)
        self._count = 0
        self._begun = b""
        self._second, self._room, self._left_out = 0, BYTES_PER_S, 0
        self._lock = Lock()

    def take(self, data: bytes, now_s: float) -> None:
        """Output as it was read."""
        with self._lock:
            if int(now_s) != self._second:
                self._second, self._room = int(now_s), BYTES_PER_S
                self._tell_gap()
            kept = data[: self._room]
            self._room -= len(kept)
            self._left_out += len(data) - len(kept)
            self._split(kept)

    def end(self) -> None:
        """Take it that there is no more: a line without its end is one."""
        with self._lock:
            if self._begun:
                self._add(self._begun)
                self._begun = b""
            self._tell_gap()

    def note(self, text: str) -> None:
        """A line of the pendant's own."""
        with self._lock:
            self._add(text.encode())

    def since(self, number: int) -> OutputPart:
        """Lines from `number` on that are still kept."""
        with self._lock:
            first = min(max(number, self._count - len(self._lines)), self._count)
            return OutputPart(first, list(self._lines)[first - self._count + len(self._lines) :])

    def _split(self, data: bytes) -> None:
        *whole, self._begun = (self._begun + data).split(b"\n")
        for line in whole:
            self._add(line)
        while len(self._begun) > MOST_LETTERS:
            self._add(self._begun[:MOST_LETTERS])
            self._begun = self._begun[MOST_LETTERS:]

    def _add(self, line: bytes) -> None:
        text = printable(line.decode(errors="replace").rstrip("\r").replace("\t", "    "))
        for at in range(0, max(len(text), 1), MOST_LETTERS):
            self._lines.append(text[at : at + MOST_LETTERS])
            self._count += 1

    def _tell_gap(self) -> None:
        if self._left_out:
            self._add(f"… {self._left_out} bytes of output are left out here".encode())
            self._left_out = 0
