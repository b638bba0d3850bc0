"""Programs that the pendant may start: those of one folder, by their names in it. No page names a path.

What the arm was led through, and was written beside its logs, is among them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from qrobot.errors import ConfigError
from qrobot.printable import printable

LANGUAGES: Final = {".py": "Python", ".c": "C", ".v2": "VAL"}
RECORDING: Final = "recording"  # in the place of a language
RECORDED: Final = "recorded/"  # before the name of a file of setpoints
MOST_PROGRAMS: Final = 500  # that are listed
DEEPEST: Final = 2  # parts of a name
MOST_LETTERS: Final = 200_000  # of a source
_VAL_PROGRAM: Final = re.compile(r"^[ \t]*\.PROGRAM[ \t]+([A-Za-z][\w.]*)", re.MULTILINE | re.IGNORECASE)


class ProgramFolder:
    """A folder and those right below it.

    Args:
        path: of the folder; None when the pendant was given none.
        recordings: where the arm's recordings are, if anywhere.
        of: their names without number and suffix.

    Raises:
        ConfigError: it is no folder, or there are no programs in it.
    """

    def __init__(self, path: Path | None, recordings: Path | None = None, of: str = "") -> None:
        self._root = None if path is None else _checked(path)
        self._recordings, self._of = recordings, of

    @property
    def where(self) -> str:
        """The folder, for people."""
        return "" if self._root is None else str(self._root)

    def listing(self) -> list[dict[str, Any]]:
        """Each program: its name, language, stamp, and the names that VAL knows in it."""
        return [_row(name, path) for name, path in self._programs().items()]

    def path_of(self, name: str) -> Path:
        """Path of a program of the folder. Raises ConfigError: there is none of that name."""
        try:
            path = self._recording(name.removeprefix(RECORDED)) if name.startswith(RECORDED) else None
            path = path or self._program(name)
        except OSError:  # as of a name that no file can have
            path = None
        if path is None:
            raise ConfigError(f"there is no program {printable(name)!r} in {self.where or 'the folder of programs'}")
        return path

    def source(self, name: str) -> str:
        """Its text, as far as a page shows it. Raises ConfigError: there is none, or it cannot be read."""
        return _text(self.path_of(name))

    def _programs(self) -> dict[str, Path]:
        found = {RECORDED + path.name: path for path in self._recorded()}
        if self._root is not None:
            found |= {str(path.relative_to(self._root)): path for path in sorted(_files(self._root))}
        return dict(list(found.items())[:MOST_PROGRAMS])

    def _program(self, name: str) -> Path | None:
        """A program of the folder, without a look at the others: the folder may be long."""
        path = None if self._root is None else self._root / name
        if path is None or self._root is None or str(path) != f"{self._root}/{name}":
            return None
        return path if _is_program(path, self._root) else None

    def _recording(self, name: str) -> Path | None:
        """The same of a recording, by its name without `RECORDED`."""
        path = None if self._recordings is None else self._recordings / name
        return path if path is not None and path.parent == self._recordings and self._is_recording(path) else None

    def _recorded(self) -> list[Path]:
        """Recordings of the arm, newest first."""
        if self._recordings is None:
            return []
        found = [path for path in self._recordings.glob("*.csv") if self._is_recording(path)]
        return sorted(found, key=lambda path: path.stat().st_mtime_ns, reverse=True)

    def _is_recording(self, path: Path) -> bool:
        return bool(re.fullmatch(re.escape(self._of) + r"(-\d+)?\.csv", path.name)) and path.is_file()


def language_of(path: Path) -> str:
    """Language of a program; what a recording has instead."""
    return LANGUAGES.get(path.suffix, RECORDING)


def stamp_of(path: Path) -> str:
    """Time of its last change in ns, which tells one version of a program from another; empty when it has gone."""
    try:
        return str(path.stat().st_mtime_ns)
    except OSError:
        return ""


def _row(name: str, path: Path) -> dict[str, Any]:
    stamp = stamp_of(path)
    return {"name": name, "language": language_of(path), "stamp": stamp, "parts": list(_parts(path, stamp))}


def _checked(path: Path) -> Path:
    """The whole path of a folder of programs."""
    try:
        root = path.resolve(strict=True)
        if root == Path(root.anchor) or not root.is_dir():
            raise ConfigError(f"--programs {path}: not a folder of programs")
        if next(_files(root), None) is None:
            raise ConfigError(f"--programs {path}: there are no programs in it: {', '.join(LANGUAGES)}")
    except OSError as error:
        raise ConfigError(f"--programs {path}: {error.strerror}") from None
    return root


def _files(root: Path) -> Iterator[Path]:
    for pattern in ("*", "*/*"):
        for path in root.glob(pattern):
            if _is_program(path, root):
                yield path


def _is_program(path: Path, root: Path) -> bool:
    """A program of the folder or of one right below it; a link may lead elsewhere."""
    parts = path.relative_to(root).parts
    hidden = any(part.startswith((".", "_")) for part in parts)
    fits = 0 < len(parts) <= DEEPEST and path.suffix in LANGUAGES and not hidden
    return fits and path.is_file() and path.resolve().is_relative_to(root)


@lru_cache(MOST_PROGRAMS)
def _parts(path: Path, _stamp: str) -> tuple[str, ...]:
    """Programs of a VAL file; empty for the others, and for one that cannot be read. Pages ask again and again."""
    if language_of(path) != "VAL":
        return ()
    try:
        return tuple(name.lower() for name in _VAL_PROGRAM.findall(_text(path)))
    except ConfigError:
        return ()


def _text(path: Path) -> str:
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            return file.read(MOST_LETTERS)
    except OSError as error:
        raise ConfigError(f"cannot read {path.name}: {error.strerror}") from None
