"""An event that SIGTERM and SIGINT set: how the processes without a loop of their own end."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType


@contextlib.contextmanager
def set_on_signals() -> Iterator[threading.Event]:
    """The event; outside the block signals do what they did before. For the main thread."""
    done = threading.Event()

    def end(_number: int, _frame: FrameType | None) -> None:
        done.set()

    before = {number: signal.signal(number, end) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield done
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
