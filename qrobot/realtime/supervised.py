"""A process ends when its supervisor does, in the order in which the supervisor would have ended it.

However a supervisor dies, the kernel closes what it held open. So each process that it starts holds the read end of a
pipe that only the supervisor can write to, the write end of the pipe of its own rank, and the read ends of those of all
higher ranks. When the first is closed, a process waits until the others are, which is when all processes of higher rank
have ended, and then asks itself to end. The supervisor keeps both ends of every pipe for processes it starts later.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import threading
import time
from collections.abc import Sequence
from typing import Final

SUPERVISOR_VARIABLE: Final = "QROBOT_SUPERVISOR"  # descriptors: the supervisor's pipe, one's own rank's, higher ranks'
RANKS: Final = 6
PATIENCE_S: Final = 10.0  # [A] with those of higher rank: a controlled stop, power off, memory removed
END_PATIENCE_S: Final = 6.0  # [A] with oneself


class Supervision:
    """The supervisor's side: pipes that close when it ends."""

    def __init__(self) -> None:
        self._pipes = contextlib.ExitStack()
        self._alive = self._pipe()  # of the supervisor
        self._ranks = [self._pipe() for _ in range(RANKS)]

    def _pipe(self) -> tuple[int, int]:
        ends = os.pipe()
        for end in ends:
            self._pipes.callback(os.close, end)
        return ends

    def descriptors(self, rank: int) -> list[int]:
        """File descriptors that a process of this rank, 0 to RANKS - 1, inherits and SUPERVISOR_VARIABLE names."""
        return [self._alive[0], self._ranks[rank][1], *(read for read, _ in self._ranks[rank + 1 :])]

    def close(self) -> None:
        """Close the pipes; processes that still run take it for the supervisor's end."""
        self._pipes.close()


def end_with_supervisor() -> None:
    """Watch the supervisor named in the environment, if there is one, in a thread; end with SIGTERM in one's turn.

    The variable is taken out and the descriptors are not inherited any further: children of this process are its own.
    """
    told = os.environ.pop(SUPERVISOR_VARIABLE, "")
    if not told:
        return
    supervisor, own, *higher = map(int, told.split(","))
    for descriptor in (supervisor, own, *higher):
        os.set_inheritable(descriptor, False)
    threading.Thread(target=_end_in_turn, args=(supervisor, higher), name="supervised", daemon=True).start()


def _end_in_turn(supervisor: int, higher: Sequence[int]) -> None:
    os.read(supervisor, 1)  # nobody ever writes: it returns when the last write end is closed
    deadline = time.monotonic() + PATIENCE_S
    for descriptor in higher:
        _await_close(descriptor, deadline)
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(END_PATIENCE_S)
    os.kill(os.getpid(), signal.SIGKILL)


def _await_close(descriptor: int, deadline: float) -> None:
    """Wait until nobody holds the other end any more, or until `deadline` of the monotonic clock."""
    closed = select.poll()
    closed.register(descriptor, 0)  # POLLHUP is always told
    closed.poll(max(0.0, deadline - time.monotonic()) * 1e3)
