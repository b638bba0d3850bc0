"""Digest of a kernel's sources: compiled code in the cache is valid as long as it is the same.

Numba looks only at the file a kernel stands in, but a kernel carries the code of every kernel it calls: after a change
in `board.py` it would go on running the old board inside the cached loop of `server.py`. Here the stamp of a file
covers the contents of everything of this package it imports, directly or not.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from functools import cache
from os.path import isfile
from pathlib import Path
from typing import Final

PACKAGE: Final = Path(__file__).resolve().parents[1]
_IMPORT: Final = re.compile(
    r"^\s*(?:from\s+(qrobot[\w.]*)\s+import\s+([^(#\n]*)|import\s+(qrobot[\w.]*))", re.MULTILINE
)


@cache
def source_stamp(path: Path) -> str:
    """Digest of a source file and of all files of this package behind it."""
    digests = sorted(_digest(source) for source in sources_behind(path))
    return hashlib.sha256("".join(digests).encode()).hexdigest()


def forget_stamps() -> None:
    """Look at the sources anew: one may have changed while the program runs."""
    for cached in (source_stamp, _digest, _imported, _file_of):
        cached.cache_clear()


def sources_behind(path: Path) -> set[Path]:
    """The file itself and every file of this package it imports, directly or not."""
    found, waiting = {path}, [path]
    while waiting:
        new = _imported(waiting.pop()) - found
        found |= new
        waiting += new
    return found


@cache
def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@cache
def _imported(path: Path) -> frozenset[Path]:
    return frozenset(_files_named(path.read_text(encoding="utf-8")))


def _files_named(text: str) -> Iterator[Path]:
    """Files of the modules that `text` imports; names that are no modules have none."""
    for package, names, module in _IMPORT.findall(text):
        yield from _file_of(module or package)
        for name in filter(str.strip, names.split(",")):
            yield from _file_of(f"{package}.{name.split(' as ')[0].strip()}")


@cache
def _file_of(module: str) -> tuple[Path, ...]:
    base = "/".join((str(PACKAGE), *module.split(".")[1:]))
    return tuple(Path(path) for path in (f"{base}.py", f"{base}/__init__.py") if isfile(path))
