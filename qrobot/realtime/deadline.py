"""Bound of a wait for another process, which may have ended: the wall clock of code that has no other.

What is waited for is an event; the deadline only bounds the wait, and says nothing when the event comes. Who waits may
be kept from running, for longer than the whole wait: the last look comes after the deadline.
"""

from __future__ import annotations

import time
from collections.abc import Callable


class Deadline:
    """Instant a number of seconds from now, on CLOCK_MONOTONIC."""

    def __init__(self, seconds: float) -> None:
        self._end_s = time.monotonic() + seconds

    @property
    def left_s(self) -> float:
        """Seconds until then, never less than nothing."""
        return max(0.0, self._end_s - time.monotonic())

    @property
    def passed(self) -> bool:
        """True when no time is left."""
        return self.left_s == 0.0


def comes_true(condition: Callable[[], object], deadline: Deadline, pause_s: float) -> bool:
    """Look until a condition holds, `pause_s` after each look; False when it does not by the deadline."""
    while True:
        last = deadline.passed
        if condition():
            return True
        if last:
            return False
        sleep_between_looks(pause_s)


def sleep_between_looks(seconds: float) -> None:
    """Leave the processor to whoever is waited for."""
    time.sleep(seconds)
