"""Files that the pendant writes beside those that are there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

from qrobot.errors import ConfigError

MOST_FILES: Final = 1000  # [A]


def led_name(arm: str) -> str:
    """Stem of the files of what an arm was led through."""
    return f"{arm}-led"


def write_beside(folder: Path, stem: str, suffix: str, write: Callable[[Path], object]) -> Path:
    """Write a file under a name that no file of the folder has: STEM.SUFFIX, STEM-1.SUFFIX and so on; its path.

    Whoever else writes there at the same time gets another name. Makes the folder.

    Args:
        write: fills the file, which is there, and empty; when it fails, the file goes.

    Raises:
        ConfigError: the folder cannot be made or written to, or is full of such files. What `write` raises.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path = _new_file(folder, stem, suffix)
        try:
            write(path)
        except BaseException:
            path.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise ConfigError(f"cannot write into {folder}: {error.strerror}") from None
    return path


def _new_file(folder: Path, stem: str, suffix: str) -> Path:
    for number in range(MOST_FILES):
        path = folder / f"{stem}{f'-{number}' if number else ''}{suffix}"
        try:
            path.open("x").close()
        except FileExistsError:
            continue
        return path
    raise ConfigError(f"{folder} has {MOST_FILES} files {stem}*{suffix}: remove some")
