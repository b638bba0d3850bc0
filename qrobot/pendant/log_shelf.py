"""Logs that pages may open: those in the folders of a deployment, and those told by name. No others."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from qrobot.errors import LogError
from qrobot.log.topics import part_beside

SUFFIX: Final = ".mcap"
INCIDENTS: Final = "incidents"  # folder beside an arm's logs
MOST_LOGS: Final = 200  # the newest
_PART_NUMBER: Final = re.compile(r"\.(\d{4,})$")  # see `log.topics.part_path`


class LogShelf:
    """Belongs to a pendant.

    Args:
        folders: of logs; their incidents are in a folder of their own.
        files: logs beside those.
    """

    def __init__(self, folders: Sequence[Path] = (), files: Sequence[Path] = ()) -> None:
        self._folders, self._files = tuple(dict.fromkeys(folders)), tuple(files)

    @property
    def asked(self) -> str:
        """Name of the log that a page opens by itself, empty for none."""
        return str(self._files[0]) if self._files else ""

    @property
    def where(self) -> list[str]:
        """Folders, for people."""
        return [str(folder.resolve()) for folder in self._folders]

    def listing(self) -> list[dict[str, Any]]:
        """Logs, newest first: name, folder, bytes of the first part, time since 1970 in s, incident or run."""
        found = [facts for path in self._paths() if (facts := _facts_of(path)) is not None]
        return sorted(found, key=lambda facts: -facts["written"])[:MOST_LOGS]

    def path_of(self, name: str) -> Path:
        """Path of a log. Raises LogError: there is none of that name here."""
        for path in self._paths():
            if str(path) == name:
                return path
        raise LogError(f"no log {name!r} here: it was moved or removed, or does not belong to this deployment")

    def _paths(self) -> Iterator[Path]:
        yield from self._files
        for folder in self._folders:
            for place in (folder, folder / INCIDENTS):
                yield from sorted(path for path in place.glob(f"*{SUFFIX}") if _begins_log(path))


def _begins_log(path: Path) -> bool:
    """Whether a file, by its name, is no later part of a log of which the part before is there."""
    number = _PART_NUMBER.search(path.stem)
    return number is None or not part_beside(path, int(number[1]), int(number[1]) - 1).exists()


def _facts_of(path: Path) -> dict[str, Any] | None:
    try:
        stat = path.stat()
    except OSError:
        return None
    kind = "incident" if path.parent.name == INCIDENTS else "run"
    return {"name": str(path), "title": path.name, "folder": str(path.parent), "bytes": stat.st_size,
            "written": stat.st_mtime, "kind": kind}  # fmt: skip
