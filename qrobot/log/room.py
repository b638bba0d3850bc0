"""Room on the disk for the logs of an arm: the oldest go when all together are more than they may be."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, TypeAlias

from qrobot.log.topics import STAMP
from qrobot.realtime.shared_memory import has_owner
from qrobot.report import Report

GIGABYTE: Final = 1_000_000_000
PARTS: Final = 4  # [A] at least so many files fill the room: so much more than a file is kept
_STAMPED: Final = r"-(\d{8}T\d{6}Z)(?:-(\d+))?(?:\.(\d{4,}))?\.mcap"  # as `fresh_path` and `part_path` name a file

Age: TypeAlias = tuple[str, int, int]  # stamp of the time, of several logs of that second which, part


@dataclass
class LogRoom:
    """Keeps the logs that a recorder writes of one arm within a size, by removing the oldest of their files.

    Only files that are named as a recorder names them are looked at, in the folder of the newest, and those that have
    begun here under another name, which a user gave. Those of incidents are in another folder, and stay; so does one
    that another recorder of the arm is writing, which counts for nothing.

    Attributes:
        arm: instance name.
        keep_gb: most of all files together, the one that is written counted as full; None for all that there are.
        part_bytes: size at which the next file begins, at most.
        report: told of what is removed, and of what cannot be.
    """

    arm: str
    keep_gb: float | None
    part_bytes: int
    report: Report
    _named: dict[Path, Age] = field(default_factory=dict, init=False, repr=False)  # begun under a user's name

    @property
    def file_bytes(self) -> int:
        """Size at which the next file begins."""
        return self.part_bytes if self.keep_gb is None else min(self.part_bytes, round(self.keep_gb * GIGABYTE / PARTS))

    def make(self, newest: Path) -> None:
        """Make room for `newest`, which has just begun, and stays."""
        if self.keep_gb is None:
            return
        try:
            self._note(newest)
            removed = self._remove_oldest(newest, round(self.keep_gb * GIGABYTE) - self.file_bytes)
        except OSError as error:
            self.report(f"old logs of {self.arm} cannot be removed to make room for newer ones: {error}")
        else:
            if removed:
                self.report(f"{self.keep_gb:g} GB of logs of {self.arm} are kept: the oldest, {removed}, are removed")

    def _note(self, newest: Path) -> None:
        """Remember the age of a file whose name does not tell it."""
        if self._maybe_age(newest) is None:
            begun = datetime.fromtimestamp(newest.stat().st_mtime, UTC).strftime(STAMP)
            self._named[newest] = begun, 0, len(self._named)

    def _remove_oldest(self, newest: Path, most_bytes: int) -> str:
        """Remove files until the others beside `newest` have so many bytes; returns the names of the removed ones."""
        sizes = {path: path.stat().st_size for path in self._oldest_first(newest) if not has_owner(path)}
        excess, removed = sum(sizes.values()) - most_bytes, []
        for path, size in sizes.items():
            if excess <= 0:
                break
            path.unlink(missing_ok=True)
            excess -= size
            removed.append(path.name)
        return ", ".join(removed)

    def _oldest_first(self, newest: Path) -> list[Path]:
        """Files of the arm's logs beside `newest`."""
        found = {path: self._maybe_age(path) for path in newest.parent.iterdir() if path != newest}
        ages = {path: age for path, age in found.items() if age is not None}
        return sorted(ages, key=lambda path: ages[path])

    def _maybe_age(self, path: Path) -> Age | None:
        """Age of a file of the arm's logs; None for another one."""
        if (match := re.fullmatch(re.escape(self.arm) + _STAMPED, path.name)) is None:
            return self._named.get(path)
        stamp, copy, part = match.groups()
        return stamp, int(copy or 1), int(part or 1)
