"""Ctrl-C where a program itself computes what has to stay whole: samples of its robots, turns of its interpreter."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, TypeAlias

from qrobot.realtime.interrupt import interrupt_heard

_Handler: TypeAlias = Callable[[int, FrameType | None], Any]


class WholeSamples:
    """Guard of samples, or of turns: Ctrl-C in one comes into force behind it. A second one does not wait.

    It counts while the program is `waiting`. So a program can stop its arm and go on after Ctrl-C, and one whose own
    function never ends can be ended. What is done inside has to end soon by itself; where it cannot, see `opened`.
    Waits of other threads, and processes whose Ctrl-C Python does not hear, are left alone.
    """

    def __init__(self) -> None:
        self._before: _Handler | None = None  # that was there before one waits
        self._inside = self._came = False

    @contextmanager
    def waiting(self) -> Iterator[None]:
        """Block in which samples pass."""
        handler = signal.getsignal(signal.SIGINT)
        mine = threading.current_thread() is threading.main_thread()
        if handler == self._hear or not callable(handler) or not mine:
            yield
            return
        around = self._before, self._inside, self._came  # of a wait around this one; a second Ctrl-C may have left them
        self._before, self._inside, self._came = handler, False, False
        try:
            signal.signal(signal.SIGINT, self._hear)
            yield
        finally:
            signal.signal(signal.SIGINT, handler)
            self._before, self._inside, self._came = around

    @contextmanager
    def one(self) -> Iterator[None]:
        """Block of one sample. Behind it KeyboardInterrupt is raised, or what else Ctrl-C does, when that has come."""
        if self._inside:
            yield
            return
        try:
            self._inside = True
            yield
        finally:
            self._end()

    @contextmanager
    def opened(self) -> Iterator[None]:
        """Block inside `one` that may wait for somebody, as for an answer: Ctrl-C comes into force in it at once."""
        inside = self._inside
        self._end()
        try:
            yield
        finally:
            self._inside = inside

    def _end(self) -> None:
        self._inside = False
        if self._came:
            self._came = False
            self._obey(signal.SIGINT, None)

    def _hear(self, number: int, frame: FrameType | None) -> None:
        interrupt_heard()
        if self._inside and not self._came:
            self._came = True
            return
        self._came = False
        self._obey(number, frame)

    def _obey(self, number: int, frame: FrameType | None) -> None:
        """Do what Ctrl-C did before; once where two guards stand behind each other, as one may that was left."""
        before = self._before or signal.default_int_handler
        self._before = None if getattr(before, "__func__", None) is WholeSamples._hear else before
        try:
            before(number, frame)
        finally:
            self._before = before
