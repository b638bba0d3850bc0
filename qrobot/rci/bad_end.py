"""Bad ends of programs: all arms begin to come to rest first, whichever library moves them.

They are let go of one after the other, and that takes time: none may go on with its motions until its turn comes.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Final

from qrobot.errors import raise_first

_stops: Final[list[Callable[[], object]]] = []


def at_bad_end(stop: Callable[[], object]) -> Callable[[], object]:
    """Have `stop` called when a program ends badly: it lets arms begin to come to rest, and waits for nothing."""
    _stops.append(stop)
    return stop


def stop_all() -> None:
    """Let all arms of the program begin to come to rest. Raises what a function of the program raises, then."""
    stop_each(_stops)


def interpreter_ends_well() -> bool:
    """Whether the interpreter ends without an error that nobody has handled."""
    return not hasattr(sys, "last_value")


def stop_each(stops: Iterable[Callable[[], object]]) -> None:
    """Call all of them, whatever one raises, a Ctrl-C or an exit too; raises the first error then."""
    errors: list[BaseException] = []
    for stop in stops:
        try:
            stop()
        except BaseException as error:
            errors.append(error)
    raise_first(errors, ours_too=True)


@contextmanager
def stopping(well: bool, stop: Callable[[], object] = stop_all) -> Iterator[None]:
    """Call `stop` when the program, or a part of it, has not ended `well`, and when the block raises."""
    try:
        if not well:
            stop()
        yield
    except BaseException:
        stop()
        raise
