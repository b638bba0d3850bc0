"""Page faults of one thread, read by another: the real-time loop itself is not asked."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Final

from qrobot.realtime.process_stat import MAJOR_FAULTS, MINOR_FAULTS, stat_fields

TASKS: Final = Path("/proc/self/task")


def page_faults(thread: int, tasks: Path = TASKS) -> int | None:
    """Minor and major page faults of `thread` of this process since it began; None when it has ended."""
    with suppress(OSError, ValueError, IndexError):
        fields = stat_fields(tasks / str(thread))
        return int(fields[MINOR_FAULTS]) + int(fields[MAJOR_FAULTS])
    return None


class FaultWatch:
    """Counts the page faults of a thread from when it is ready.

    Attributes:
        count: page faults so far.
    """

    def __init__(self, tasks: Path = TASKS) -> None:
        self.count = 0
        self._tasks = tasks
        self._thread: int | None = None
        self._before = 0

    def begin(self, thread: int) -> None:
        """Count the page faults of `thread` from now on."""
        self._before = page_faults(thread, self._tasks) or 0
        self._thread = thread

    def look(self) -> int:
        """Page faults since the last look."""
        now = None if self._thread is None else page_faults(self._thread, self._tasks)
        if now is None or now <= self._before:
            return 0
        new, self._before = now - self._before, now
        self.count += new
        return new
