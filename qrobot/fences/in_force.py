"""The fences round the arms of the program that runs: put in force by whoever starts it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from qrobot.fences.fence_set import FenceSet

_fences: ContextVar[FenceSet | None] = ContextVar("fences", default=None)


@contextmanager
def use_fences(fences: FenceSet | None) -> Iterator[None]:
    """Arms of that robot that are taken in this block keep within these fences."""
    token = _fences.set(fences)
    try:
        yield
    finally:
        _fences.reset(token)


def fences_for(robot: str) -> FenceSet | None:
    """The fences for an arm that is taken now, by the name in its robot file; None for none."""
    fences = _fences.get()
    return fences if fences is not None and fences.robot == robot else None
