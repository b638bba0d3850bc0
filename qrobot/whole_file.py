"""Files that are written whole: whoever reads one finds the old content or the new one, whatever dies meanwhile."""

from __future__ import annotations

import contextlib
import os
import tempfile
from pathlib import Path
from typing import Final

NEW_FILE: Final = 0o644


def replace_file(path: Path, text: str, encoding: str = "utf-8") -> None:
    """Write `text`, whose line ends stay as they are. See `replace_bytes`."""
    replace_bytes(path, text.encode(encoding))


def replace_bytes(path: Path, content: bytes) -> None:
    """Write `content`. A link goes on pointing to its file, and a file keeps its rights.

    What is no file, such as a terminal, is written to. Raises OSError; the old content is there still.
    """
    target = path.resolve()
    if target.exists() and not target.is_file():
        with target.open("wb") as device:
            device.write(content)
        return
    rights = target.stat().st_mode & 0o777 if target.exists() else NEW_FILE
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name[:100]}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        Path(name).chmod(rights)
        Path(name).replace(target)
        _sync_folder(target.parent)
    except BaseException:
        with contextlib.suppress(OSError):
            Path(name).unlink()
        raise


def _sync_folder(folder: Path) -> None:
    """Make the new name last through a loss of supply."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
