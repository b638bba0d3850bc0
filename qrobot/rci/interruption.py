"""Ctrl-C on virtual time, where the program itself computes the samples of its robots."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any, Final

HANDS_OFF: Final = None  # the handler of a thread, or of a process, whose Ctrl-C is somebody else's


class WholeSamples:
    """Block at whose end Ctrl-C comes into force: half a sample would cost the robot. A second one does not wait.

    So a program can stop its arm and go on after Ctrl-C, and one whose own function never ends can be ended. Other
    threads, and processes whose Ctrl-C Python does not hear, are left alone.
    """

    def __init__(self) -> None:
        self._handler: Callable[[int, FrameType | None], Any] | None = HANDS_OFF
        self._came = False

    def __enter__(self) -> None:
        handler = signal.getsignal(signal.SIGINT)
        if not callable(handler) or threading.current_thread() is not threading.main_thread():
            self._handler = HANDS_OFF
            return
        self._handler, self._came = handler, False
        signal.signal(signal.SIGINT, self._hear)

    def __exit__(self, *_: object) -> None:
        if self._handler is HANDS_OFF:
            return
        signal.signal(signal.SIGINT, self._handler)
        if self._came:
            self._handler(signal.SIGINT, None)

    def _hear(self, number: int, frame: FrameType | None) -> None:
        if self._came and self._handler is not HANDS_OFF:
            self._came = False
            self._handler(number, frame)
            return
        self._came = True
