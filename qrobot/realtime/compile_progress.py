"""Progress of compiling: which kernel of how many, for who waits for a first start. Needs no Numba, which loads
slowly."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

CompileListener = Callable[[str, int, int], None]  # name, the how-manieth, of how many
COMPILING: Final = "compiling kernel"
"""How a line begins that a process prints of it."""
SHORT: Final = 20  # kernels; what takes a second or two is not told

_listeners: Final[list[CompileListener]] = []


class _Entry:
    """The kernel being compiled with all below it."""

    below: frozenset[str] = frozenset()
    waiting: set[str] = set()  # noqa: RUF012 (the one entry there is)


def tell_compiling(listener: CompileListener) -> None:
    """Call `listener` for each kernel, when many have to be compiled."""
    _listeners.append(listener)


def begin_entry(below: set[str]) -> None:
    """Note which kernels have to be compiled for the one that is called; a part of that one brings no new ones."""
    if not below <= _Entry.below:
        _Entry.below, _Entry.waiting = frozenset(below), set(below)


def begin_kernel(name: str) -> None:
    """Tell that one of them is compiled now. A few come once more, for arguments of other types; they are not told."""
    end_part({name})


def end_part(names: set[str]) -> None:
    """Tell that these need not be compiled any more; of a part, another process may have done it."""
    if done := names & _Entry.waiting:
        _Entry.waiting -= done
        _tell(min(done), len(_Entry.below) - len(_Entry.waiting), len(_Entry.below))


def _tell(name: str, number: int, of: int) -> None:
    for listener in _listeners if of >= SHORT else ():
        listener(name, number, of)
