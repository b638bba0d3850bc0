"""Room on the disk for the logs of an arm: the oldest go when all together are more than they may be."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from qrobot.report import Report

GIGABYTE: Final = 1_000_000_000
PARTS: Final = 4  # [A] at least so many files fill the room: so much more than a file is kept
_STAMP: Final = r"-(\d{8}T\d{6}Z)(?:-(\d+))?(?:\.(\d{4,}))?\.mcap"  # as `fresh_path` and `part_path` name a file


@dataclass
class LogRoom:
    """Keeps the logs that a recorder writes of one arm within a size, by removing the oldest of their files.

    Only files that are named as a recorder names them are looked at, in the folder of the newest; those of incidents
    are in another folder, and stay.

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

    @property
    def file_bytes(self) -> int:
        """Size at which the next file begins."""
        return self.part_bytes if self.keep_gb is None else min(self.part_bytes, round(self.keep_gb * GIGABYTE / PARTS))

    def make(self, newest: Path) -> None:
        """Make room for `newest`, which has just begun, and stays."""
        if self.keep_gb is None:
            return
        try:
            removed = self._remove_oldest(newest, round(self.keep_gb * GIGABYTE) - self.file_bytes)
        except OSError as error:
            self.report(f"old logs of {self.arm} cannot be removed to make room for newer ones: {error}")
        else:
            if removed:
                self.report(f"{self.keep_gb:g} GB of logs of {self.arm} are kept: the oldest, {removed}, are removed")

    def _remove_oldest(self, newest: Path, most_bytes: int) -> str:
        """Remove files until the others beside `newest` have so many bytes; returns the names of the removed ones."""
        sizes = {path: path.stat().st_size for path in self._oldest_first(newest)}
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
        name = re.compile(re.escape(self.arm) + _STAMP)
        found = {path: name.fullmatch(path.name) for path in newest.parent.iterdir() if path != newest}
        ages = {path: _age(*match.groups()) for path, match in found.items() if match is not None}
        return sorted(ages, key=lambda path: ages[path])


def _age(stamp: str, copy: str | None, part: str | None) -> tuple[str, int, int]:
    return stamp, int(copy or 1), int(part or 1)
