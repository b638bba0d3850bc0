"""The fences round the arms of the program that runs: put in force by whoever starts it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from qrobot.fences.fence_set import FenceSet

_fences: ContextVar[tuple[FenceSet | None, str]] = ContextVar("fences", default=(None, ""))  # and the arm's bridge


@contextmanager
def use_fences(fences: FenceSet | None, bridge: str = "") -> Iterator[None]:
    """The arm of that robot, at `bridge` or at none that has a name, keeps within these fences when taken in here."""
    token = _fences.set((fences, bridge))
    try:
        yield
    finally:
        _fences.reset(token)


def fences_for(robot: str, bridge: str = "") -> FenceSet | None:
    """The fences for an arm that is taken now, ready to be asked between two samples; None for none.

    Args:
        robot: the name in its robot file.
        bridge: the address at which the program has named it, "host:port"; empty for the arm of the program.
    """
    fences, place = _fences.get()
    if fences is None or fences.robot != robot or bridge not in ("", place):
        return None
    return fences.compiled()
