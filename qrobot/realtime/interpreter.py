"""The share that a real-time thread of this program has of the interpreter, so that it runs when a sample is due.

Three things keep a thread of Python waiting that the scheduler would let run: another thread computes and has the
interpreter, that thread has it and does not run itself, or Python looks for garbage. The search goes over every object
that lives, 100,000 of them where the numerical libraries are imported, and takes as long as two or three samples.
"""

from __future__ import annotations

import gc
import sys
import time
from contextlib import ExitStack
from functools import cache
from typing import Final

from qrobot.realtime.setup import favoured_thread, freeze_garbage

# How long a thread that computes keeps the interpreter when another has a sample to make, which asks several times.
TURN_S: Final = 0.0005


def prepare_interpreter() -> None:
    """Let threads take short turns; the first time also exempt all that lives now from searches for garbage.

    The first time takes as long as one search: a program does it before it greets a robot, which waits for no one. What
    is exempt is never given back, so it is not done again in a process that takes arm after arm.
    """
    sys.setswitchinterval(min(TURN_S, sys.getswitchinterval()))
    _exempt_once()


@cache
def _exempt_once() -> None:
    freeze_garbage()


class InterpreterShare:
    """The calling thread, the program's own, waits for few others from begin to end; searches for garbage are timed.

    Attributes:
        longest_search_ms: time of the longest search for garbage since it began.
    """

    def __init__(self) -> None:
        self.longest_search_ms = 0.0
        self._began_s = 0.0
        self._undo = ExitStack()

    def begin(self) -> None:
        """Begin, in the program's own thread."""
        gc.callbacks.append(self._searching)
        self._undo.callback(gc.callbacks.remove, self._searching)
        self._undo.enter_context(favoured_thread())

    def end(self) -> None:
        """The program is an ordinary one again; does nothing a second time, or before it began."""
        self._undo.close()

    def complaint(self, limit_ms: float) -> str:
        """Remark for a stop that a search of more than `limit_ms` may have caused; empty when there was none."""
        if self.longest_search_ms <= limit_ms:
            return ""
        return (
            f"; Python looked for garbage among the program's objects for {self.longest_search_ms:.0f} ms:"
            " call gc.freeze() once they are made"
        )

    def _searching(self, phase: str, _: dict[str, int]) -> None:
        now_s = time.perf_counter()
        if phase == "start":
            self._began_s = now_s
        else:
            self.longest_search_ms = max(self.longest_search_ms, (now_s - self._began_s) * 1e3)
