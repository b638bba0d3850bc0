"""Logs as commands read them: with a word on what is missing."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from qrobot.cli.console import note
from qrobot.errors import ConfigError

if TYPE_CHECKING:
    from qrobot.log.read import Log


_LATER_PART: Final = re.compile(r"(.+)\.\d{4}(\.mcap)")  # as `part_path` names it


def first_parts(files: Sequence[Path]) -> list[Path]:
    """One file for each log: later parts of a log whose first part is there too are left out.

    Raises ConfigError when there is no file.
    """
    if not files:
        raise ConfigError("name at least one log, such as out/puma560-*.mcap")
    return [file for file in files if _first_part_of(file) not in files]


def _first_part_of(file: Path) -> Path | None:
    found = _LATER_PART.fullmatch(file.name)
    return file.with_name(found[1] + found[2]) if found else None


def read_and_warn(path: Path) -> Log:
    """A log; what damage to its files has cost is told on stderr.

    Raises:
        LogError: as `read_log`, and when damage has left nothing of it.
    """
    from qrobot.errors import LogError
    from qrobot.log.read import read_log

    log = read_log(path)
    if log.lost and not log.rows.size:
        raise LogError(f"{path} is damaged, and no cycle can be read")
    for lost in log.lost:
        note(f"warning: {path} is damaged: {lost.line} are lost, the others are read")
    return log
