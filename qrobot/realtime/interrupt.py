"""Ctrl-C for a program whose only thread is in compiled code, which may never come back to Python."""

from __future__ import annotations

import os
import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Final

PATIENCE_S: Final = 2.0
INTERRUPTED: Final = 130  # exit status of a command that SIGINT has ended
_heeding: list[threading.Event] = []  # of each block: Python has heard


@contextmanager
def heed_interrupts(patience_s: float = PATIENCE_S) -> Iterator[None]:
    """End this process when SIGINT comes and Python does not get to hear of it within `patience_s`.

    Otherwise SIGINT does what it did before. Only the main thread may ask for it; in another one nothing changes.
    """
    handler = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(handler):
        yield
        return
    heard, over = threading.Event(), threading.Event()

    def hear(number: int, frame: FrameType | None) -> None:
        interrupt_heard()
        handler(number, frame)

    ours, wakes = socket.socketpair()
    wakes.setblocking(False)
    before = signal.set_wakeup_fd(wakes.fileno(), warn_on_full_buffer=False)  # written to before any Python runs
    signal.signal(signal.SIGINT, hear)
    _heeding.append(heard)
    threading.Thread(target=_watch, args=(ours, heard, over, patience_s), name="interrupt", daemon=True).start()
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
        _heeding.remove(heard)
        signal.set_wakeup_fd(before)
        over.set()  # SIGINT does again what it did before
        wakes.close()  # the watch reads its end


def interrupt_heard() -> None:
    """Tell blocks of `heed_interrupts` that SIGINT has come to Python: for a handler inside one that obeys later."""
    for heard in _heeding:
        heard.set()


def _watch(signals: socket.socket, heard: threading.Event, over: threading.Event, patience_s: float) -> None:
    with signals:
        while number := signals.recv(1):
            if number[0] != signal.SIGINT:
                continue
            if heard.wait(patience_s):
                heard.clear()
                _forget(signals)
            elif not over.is_set():
                os._exit(INTERRUPTED)


def _forget(signals: socket.socket) -> None:
    """Drop what has come meanwhile: Python hears signals of one number, until it gets to them, as one."""
    with suppress(BlockingIOError):
        while signals.recv(64, socket.MSG_DONTWAIT):
            pass
