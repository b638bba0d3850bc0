"""Ctrl-C on virtual time, where the program itself computes the samples of its robots."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any


class WholeSamples:
    """Guard of samples: Ctrl-C in one, while the program waits, comes into force behind it; a second one does not wait.

    So a program can stop its arm and go on after Ctrl-C, and one whose own function never ends can be ended. Waits of
    other threads, and processes whose Ctrl-C Python does not hear, are left alone.
    """

    def __init__(self) -> None:
        self._handler: Callable[[int, FrameType | None], Any] | None = None  # that was there before, while one waits
        self._inside = self._came = False

    @contextmanager
    def waiting(self) -> Iterator[None]:
        """Block in which samples pass."""
        handler = signal.getsignal(signal.SIGINT)
        mine = threading.current_thread() is threading.main_thread()
        if self._handler is not None or not callable(handler) or not mine:
            yield
            return
        self._handler = handler
        signal.signal(signal.SIGINT, self._hear)
        try:
            yield
        finally:
            self._handler = None
            signal.signal(signal.SIGINT, handler)

    def begin(self) -> None:
        """A sample begins."""
        self._inside = True

    def end(self) -> None:
        """The sample is whole. Raises KeyboardInterrupt, or does what else Ctrl-C does, when that has come."""
        self._inside = False
        if self._came:
            self._came = False
            self._obey(signal.SIGINT, None)

    def _hear(self, number: int, frame: FrameType | None) -> None:
        if self._inside and not self._came:
            self._came = True
            return
        self._came = False
        self._obey(number, frame)

    def _obey(self, number: int, frame: FrameType | None) -> None:
        if self._handler is not None:
            self._handler(number, frame)
