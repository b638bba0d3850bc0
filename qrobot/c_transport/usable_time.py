"""Time that a process could use: what it waited for a processor is not its own doing."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

PROCESSES: Final = Path("/proc")
_STATE, _USER, _SYSTEM = 0, 11, 12  # fields behind the name in brackets (proc(5): state is the 3rd, utime the 14th)
_TICKS_PER_S: Final = os.sysconf("SC_CLK_TCK")


class UsableTime:
    """Time that a program can use, so that one that shares a processor with others is not taken for slow.

    It is all that passes while its threads sleep or are stopped, else what it got of the processors.

    Args:
        process: the program's number.
        processes: where the kernel shows its processes (proc(5)).
    """

    def __init__(self, process: int, processes: Path = PROCESSES) -> None:
        self._folder = processes / str(process)
        self._used_s = self._processor_s()

    def begin(self) -> None:
        """Count from now on."""
        self._used_s = self._processor_s()

    def usable_s(self, passed_s: float) -> float:
        """Part of `passed_s` since the last look that the program could use; all when nothing is known of it."""
        before, self._used_s = self._used_s, self._processor_s()
        return min(passed_s, self._used_s - before) if self._wants_a_processor() else passed_s

    def _processor_s(self) -> float:
        try:
            fields = _fields(self._folder / "stat")
            return (int(fields[_USER]) + int(fields[_SYSTEM])) / _TICKS_PER_S
        except (OSError, ValueError, IndexError):
            return 0.0

    def _wants_a_processor(self) -> bool:
        try:
            return any(_fields(thread / "stat")[_STATE] == "R" for thread in (self._folder / "task").iterdir())
        except (OSError, IndexError):
            return False


def _fields(stat: Path) -> list[str]:
    return stat.read_text().rpartition(")")[2].split()
