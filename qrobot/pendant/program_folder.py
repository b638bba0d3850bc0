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

LANGUAGES: Final = {".py": "Python", ".c": "C", ".v2": "VAL"}
RECORDING: Final = "recording"  # in the place of a language
RECORDED: Final = "recorded/"  # before the name of a file of setpoints
MOST_PROGRAMS: Final = 500
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
        programs = self._programs()
        if name not in programs:
            raise ConfigError(f"there is no program {name!r} in {self.where or 'the folder of programs'}")
        return programs[name]

    def source(self, name: str) -> str:
        """Its text, as far as a page shows it. Raises ConfigError: there is none, or it cannot be read."""
        return _text(self.path_of(name))

    def _programs(self) -> dict[str, Path]:
        found = {RECORDED + path.name: path for path in self._recorded()}
        if self._root is not None:
            found |= {str(path.relative_to(self._root)): path for path in sorted(_files(self._root))}
        return dict(list(found.items())[:MOST_PROGRAMS])

    def _recorded(self) -> list[Path]:
        """Recordings of the arm, newest first."""
        if self._recordings is None:
            return []
        name = re.compile(re.escape(self._of) + r"(-\d+)?\.csv")
        found = [path for path in self._recordings.glob("*.csv") if name.fullmatch(path.name) and path.is_file()]
        return sorted(found, key=lambda path: path.stat().st_mtime_ns, reverse=True)


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
            hidden = any(part.startswith((".", "_")) for part in path.relative_to(root).parts)
            if path.suffix in LANGUAGES and not hidden and path.is_file() and _is_inside(path, root):
                yield path


def _is_inside(path: Path, root: Path) -> bool:
    """A link may lead elsewhere."""
    return path.resolve().is_relative_to(root)


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
