"""Turns of tests on the wall clock, which run in two rows beside each other: one that starves others waits for its own.

A real-time thread that never comes back keeps its processor even from the servos of other arms, up to a second.
"""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

LOCK: Final = Path(__file__).parents[2] / ".pytest_cache" / "live tests"


@contextmanager
def turn(alone: bool) -> Iterator[None]:
    """A turn beside others, or `alone`, when those of the other row have ended."""
    LOCK.parent.mkdir(exist_ok=True)
    with LOCK.open("a") as file:
        fcntl.flock(file, fcntl.LOCK_EX if alone else fcntl.LOCK_SH)
        yield
