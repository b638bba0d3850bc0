"""Fields of the `stat` that the kernel shows of a process or thread (proc(5))."""

from __future__ import annotations

from pathlib import Path
from typing import Final

# Places of fields behind the name in brackets, which may hold anything: the page counts from 1, the name being the 2nd.
STATE: Final = 0
MINOR_FAULTS: Final = 7
MAJOR_FAULTS: Final = 9
USER_TICKS: Final = 11
SYSTEM_TICKS: Final = 12


def stat_fields(folder: Path) -> list[str]:
    """Fields behind the name, of the process or thread with this folder. Raises OSError: it has ended."""
    return (folder / "stat").read_text().rpartition(")")[2].split()
