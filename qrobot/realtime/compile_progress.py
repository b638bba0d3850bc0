"""Progress of compiling: which kernel of how many, for who waits for a first start. Needs no Numba, which loads
slowly."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

CompileListener = Callable[[str, int, int], None]  # name, the how-manieth, of how many
SHORT: Final = 20  # kernels; what takes a second or two is not told

_listeners: Final[list[CompileListener]] = []


class _Entry:
    """The kernel being compiled with all below it."""

    done = 0
    of = 0


def tell_compiling(listener: CompileListener) -> None:
    """Call `listener` for each kernel, when many have to be compiled."""
    _listeners.append(listener)


def begin_entry(kernels: int) -> None:
    """Note how many kernels have to be compiled for the one that is called."""
    _Entry.done, _Entry.of = 0, kernels


def begin_kernel(name: str) -> None:
    """Tell that one of them is compiled now. A few come once more, for arguments of other types; they are not told."""
    _Entry.done += 1
    if _Entry.done <= _Entry.of >= SHORT:
        for listener in _listeners:
            listener(name, _Entry.done, _Entry.of)
