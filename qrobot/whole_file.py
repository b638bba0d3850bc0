"""Files that are written whole: whoever reads one finds the old content or the new one, whatever dies meanwhile."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

NEW_FILE: Final = 0o644
PROBE_BYTES: Final = 4096  # a full disk takes an empty file


def probe_folder(folder: Path) -> None:
    """Raise OSError when there can be no new file in a folder; one without a name is made, written and forgotten."""
    with tempfile.TemporaryFile(dir=folder) as probe:
        probe.write(bytes(PROBE_BYTES))
        probe.flush()


def probe_file(path: Path) -> None:
    """Raise OSError when a file that is there may not be written to; it stays as it is."""
    if path.exists():
        with path.open("ab"):
            pass


def replace_file(path: Path, text: str, encoding: str = "utf-8") -> None:
    """Write `text`, whose line ends stay as they are. See `replace_bytes`."""
    replace_bytes(path, text.encode(encoding))


def replace_bytes(path: Path, content: bytes) -> None:
    """Write `content`. See `written_whole`."""
    with written_whole(path) as place:
        place.write_bytes(content)


@contextlib.contextmanager
def written_whole(path: Path, ending: str = "") -> Iterator[Path]:
    """A file to write to, which takes the place of `path` when the block ends; when that fails, `path` is as it was.

    A link goes on pointing to its file, and a file keeps its rights. What is no file, such as a terminal, is written to
    itself. Raises OSError.

    Args:
        ending: of the file's name meanwhile, for writers that choose their form by it.
    """
    target = path.resolve()
    if target.exists() and not target.is_file():
        yield target
        return
    rights = target.stat().st_mode & 0o777 if target.exists() else NEW_FILE
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name[:100]}.", suffix=ending)
    os.close(handle)
    place = Path(name)
    try:
        yield place
        _sync(place)
        place.chmod(rights)
        place.replace(target)
        _sync(target.parent)
    except BaseException:
        with contextlib.suppress(OSError):
            place.unlink()
        raise


def _sync(path: Path) -> None:
    """Make the content of a file, or the names in a folder, last through a loss of supply."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
