"""Files that the pendant writes beside those that are there."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from qrobot.errors import ConfigError

MOST_FILES: Final = 1000  # [A]


def led_name(arm: str) -> str:
    """Stem of the files of what an arm was led through."""
    return f"{arm}-led"


def free_path(folder: Path, stem: str, suffix: str) -> Path:
    """A name in a folder that no file has: STEM.SUFFIX, STEM-1.SUFFIX and so on. Makes the folder.

    Raises ConfigError: it cannot be made, or is full of such files.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"cannot write into {folder}: {error.strerror}") from None
    for number in range(MOST_FILES):
        path = folder / f"{stem}{f'-{number}' if number else ''}{suffix}"
        if not path.exists():
            return path
    raise ConfigError(f"{folder} has {MOST_FILES} files {stem}*{suffix}: remove some")
