"""How long tests wait: what has to come may take its time, for any machine may stall."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Final

_FACTOR: Final = float(os.environ.get("QROBOT_PATIENCE", "1"))  # for a clock that goes too fast (tests/machines)
PATIENCE_S: Final = 60.0 * _FACTOR  # with what has to come; only a test that fails waits that long
PATIENCE_MS: Final = 60_000.0 * _FACTOR
STALL_MS: Final = 600.0  # by which a process may be late where others want the processor too
MOMENT_S: Final = 0.05  # with what will not come
_POLL_S, _LONGEST_POLL_S = 0.001, 0.01  # a test that waits takes little from what it waits for


def give_time(seconds: float = MOMENT_S) -> None:
    """Let pass what must not come: too short a time may hide a fault, but never makes one."""
    time.sleep(seconds)


def wait_until(
    condition: Callable[[], object], what: str | Callable[[], object] = "it", seconds: float = PATIENCE_S
) -> None:
    """Poll on the wall clock. Fails the test when the condition does not come true within `seconds`.

    `what` it is, or a function that says so, and how things stand, when it has not come.
    """
    deadline, poll_s = time.monotonic() + seconds, _POLL_S
    while not condition():
        assert time.monotonic() < deadline, f"not within {seconds:g} s: {what() if callable(what) else what}"
        time.sleep(poll_s)
        poll_s = min(1.2 * poll_s, _LONGEST_POLL_S)
