"""Real-time priority of the loop's thread: lent as long as it runs cycles.

A law that never comes back would keep its processor from everybody below it, other arms' servos too, as long as its
process lives: the kernel leaves ordinary threads a twentieth of each second, and real-time threads of a lower priority
nothing. The guardian has torque and power by then; here the thread becomes an ordinary one until it runs cycles again.
Once the guardian is seen to have the board, that priority serves nobody: the patience with it is a tenth.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from qrobot.units import NS_PER_S

PATIENCE_NS: Final = NS_PER_S  # without a cycle
# One look may stand for so much of it: a process that was stopped as a whole looks before its loop can run again.
LOOK_NS: Final = PATIENCE_NS // 2
TAKEN_WEIGHT: Final = 10  # so many times as long does a wait count beside a guardian that has taken the board


class LoopPriority:
    """Takes the priority of a thread that runs no cycle, and gives it back.

    Args:
        thread: its number in the system.
        say: tells people.
    """

    def __init__(self, thread: int, say: Callable[[str], None]) -> None:
        self._thread, self._say = thread, say
        self._beat, self._looked_ns, self._waited_ns = -1, 0, 0
        self._lent: tuple[int, os.sched_param] | None = None  # what to give back

    def look(self, beat: int, now_ns: int, taken: bool) -> None:
        """Look at the thread, whose cycles count `beat`; to be called again and again.

        `taken` says that the guardian has the board. With one processor the looks are rare while the loop hangs: the
        caller has a twentieth of it, too.
        """
        since_ns, self._looked_ns = now_ns - self._looked_ns, now_ns
        if beat != self._beat:
            self._beat, self._waited_ns = beat, 0
            self._give_back()
            return
        self._waited_ns += min(since_ns * (TAKEN_WEIGHT if taken else 1), LOOK_NS)
        if self._waited_ns >= PATIENCE_NS and self._lent is None:
            self._take()

    def _take(self) -> None:
        with suppress(OSError):  # the thread has ended meanwhile
            policy, priority = os.sched_getscheduler(self._thread), os.sched_getparam(self._thread)
            if policy & ~os.SCHED_RESET_ON_FORK != os.SCHED_FIFO:
                return
            ordinary = os.SCHED_OTHER | (policy & os.SCHED_RESET_ON_FORK)
            os.sched_setscheduler(self._thread, ordinary, os.sched_param(0))
            self._lent = policy, priority
            self._say("the loop runs no cycle: its thread is an ordinary one now, so that others get the processor")

    def _give_back(self) -> None:
        if self._lent is None:
            return
        (policy, priority), self._lent = self._lent, None
        try:
            os.sched_setscheduler(self._thread, policy, priority)
        except OSError as error:
            self._say(f"the loop runs again, without a real-time priority ({error}): start the servo anew")
        else:
            self._say("the loop runs again, at its real-time priority")
