"""Time that a process could use: what it waited for a processor is not its own doing."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from qrobot.realtime.process_stat import STATE, SYSTEM_TICKS, USER_TICKS, stat_fields

PROCESSES: Final = Path("/proc")
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
            fields = stat_fields(self._folder)
            return (int(fields[USER_TICKS]) + int(fields[SYSTEM_TICKS])) / _TICKS_PER_S
        except (OSError, ValueError, IndexError):
            return 0.0

    def _wants_a_processor(self) -> bool:
        try:
            return any(stat_fields(thread)[STATE] == "R" for thread in (self._folder / "task").iterdir())
        except (OSError, IndexError):
            return False
