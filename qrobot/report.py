"""Reports to people: one line of text at a time, to a function that each part is given."""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable
from queue import SimpleQueue
from types import TracebackType
from typing import Final, Self, TypeAlias

Report: TypeAlias = Callable[[str], None]

KEPT_LINES: Final = 1000  # [A] that wait to be written; what is told beyond them is lost
LAST_LINES_S: Final = 1.0  # [A] that the end waits for what is still to be written
_TURNS: Final = 20  # in so many parts: a process that was kept from running for all of it has its turns still to come


class QueuedReport:
    """A report that returns at once and raises nothing: a thread of its own writes the lines, in order.

    For processes that move an arm or keep it safe. Neither a terminal that is held (Ctrl-S) nor a full disk behind a
    redirected stderr may make them wait or end; a line that cannot be written is lost.

    Args:
        report: writes one line.
        begin: called first in that thread. A real-time thread that runs Python gives it its own priority here: it waits
            for the interpreter's lock, which the writing of a line holds.
    """

    def __init__(self, report: Report, begin: Callable[[], object] = lambda: None) -> None:
        self._report, self._begin = report, begin
        self._lines = SimpleQueue[str | threading.Event | None]()
        self._written = threading.Event()  # all that was told when `flush` was called last
        self._written.set()
        self._told = False  # something since the last `flush`
        self._thread = threading.Thread(target=self._write, name="report", daemon=True)
        self._thread.start()

    def __call__(self, line: str) -> None:
        """Tell one line."""
        if self._lines.qsize() < KEPT_LINES:
            self._lines.put(line)
            self._told = True

    def flush(self, seconds: float) -> None:
        """Wait so long at most until what was told since is written; not at all while an earlier wait is in vain."""
        if self._told and self._written.is_set():
            self._told = False  # first: what is told meanwhile is for the next one
            self._written = threading.Event()
            self._lines.put(self._written)
            self._written.wait(seconds)

    def close(self) -> None:
        """Wait a moment for what is still to be written; later lines are lost."""
        self._lines.put(None)
        for _ in range(_TURNS):
            self._thread.join(LAST_LINES_S / _TURNS)

    def _write(self) -> None:
        self._begin()
        while (line := self._lines.get()) is not None:
            if isinstance(line, threading.Event):
                line.set()
                continue
            with contextlib.suppress(Exception, SystemExit):  # Rich exits when nobody reads stderr any more
                self._report(line)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class ReportHandler(logging.Handler):
    """Tells what this process logs, its libraries included, to a report in place of stderr."""

    def __init__(self, report: Report) -> None:
        super().__init__()
        self._report = report

    def emit(self, record: logging.LogRecord) -> None:
        """Tell one record, as it came where its words cannot be made, by its place where it has none at all."""
        try:
            line = self.format(record)
        except Exception:  # whatever the words of its values raise: who logs must go on
            line = _as_it_came(record)
        self._report(line)


def _as_it_came(record: logging.LogRecord) -> str:
    """Words and values of a record, or its place where those cannot be written either."""
    try:
        return f"{record.msg} {record.args}"
    except Exception:
        return f"{record.filename}: line {record.lineno} logs what cannot be written"
