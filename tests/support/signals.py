"""Signals as a process of a terminal knows them, wherever the tests were started from."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from qrobot.realtime.signals import handled


@contextmanager
def default_signals(*numbers: signal.Signals) -> Iterator[None]:
    """Processes started in the block hear these, though `nohup` or the background of a script has them ignored."""
    with handled(dict.fromkeys(numbers, signal.SIG_DFL)):
        yield


def at_once(*numbers: signal.Signals) -> None:
    """Have the main thread, which calls, meet them all at one moment."""
    signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    for number in numbers:
        signal.pthread_kill(threading.get_ident(), number)  # those of the process another thread would take
    signal.pthread_sigmask(signal.SIG_UNBLOCK, numbers)


@contextmanager
def ctrl_c_at(event: int, within: str | tuple[str, ...]) -> Iterator[list[int]]:
    """Ctrl-C at the line of this number, of code in files whose paths begin so; gives how many lines there were."""
    seen = [0]

    def look(_frame: FrameType, what: str, _argument: Any) -> Any:
        if what == "line":
            seen[0] += 1
            if seen[0] == event:
                signal.raise_signal(signal.SIGINT)
        return look

    def enter(frame: FrameType, _what: str, _argument: Any) -> Any:
        return look if frame.f_code.co_filename.startswith(within) else None

    before = sys.gettrace()
    sys.settrace(enter)
    try:
        yield seen
    finally:
        sys.settrace(before)
