"""Errors in a user's program, told by the user's own lines: those of files that nobody else installed."""

from __future__ import annotations

import sysconfig
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from qrobot.printable import printable

PACKAGE: Final = Path(__file__).resolve().parents[1]
INSTALLED: Final = tuple(
    Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib", "purelib", "platlib", "scripts")
)


def own_traceback(error: BaseException) -> str:
    """The traceback of an exception with the frames of the user's files alone, and so of those that caused it."""
    told = traceback.TracebackException.from_exception(error)
    hidden = sum(map(_leave_own_frames, _chain(told)))
    note = f"({hidden} frames of others are left out: --traceback shows them)\n" if hidden else ""
    return note + printable_lines("".join(told.format()))


def own_place(error: BaseException) -> str:
    """File and line of the innermost frame in the user's files, as ` (FILE, line N)`; empty when there is none."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if is_own(frame.filename)]
    return f" ({frames[-1].filename}, line {frames[-1].lineno})" if frames else ""


def is_own(filename: str) -> bool:
    """True for a file that belongs neither to this package nor to an installed one, nor to Python."""
    if filename.startswith("<frozen "):
        return False
    path = Path(filename).resolve()
    return not any(path.is_relative_to(folder) for folder in (PACKAGE, *INSTALLED))


def printable_lines(text: str) -> str:
    """A text of several lines without what could steer a terminal."""
    return "".join(f"{printable(line)}\n" for line in text.splitlines())


def _chain(told: traceback.TracebackException | None) -> Iterator[traceback.TracebackException]:
    """An exception, what caused it, and during what it came; those of a group too."""
    if told is None:
        return
    yield told
    context = None if told.__suppress_context__ else told.__context__
    for other in (told.__cause__, context, *(told.exceptions or ())):
        yield from _chain(other)


def _leave_own_frames(told: traceback.TracebackException) -> int:
    """Take other people's frames out; their number."""
    own = [frame for frame in told.stack if is_own(frame.filename)]
    hidden = len(told.stack) - len(own)
    told.stack[:] = own
    return hidden
