"""A process of a rig that ends by itself: it is started again, the others go on without it, or they are ended too."""

from __future__ import annotations

import time
from collections import defaultdict, deque
from collections.abc import Callable
from typing import Final

from qrobot.errors import LinkLost
from qrobot.rig.processes import Child, ProcessRig

WINDOW_S: Final = 60.0


class Restarts:
    """Looks after the processes of a rig, as their plans say.

    Args:
        report: takes a line for each process that has ended.
        now_s: a clock that only goes forward, seconds.
    """

    def __init__(
        self, rig: ProcessRig, report: Callable[[str], None], now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._rig, self._report, self._now_s = rig, report, now_s
        self._ends: defaultdict[str, deque[float]] = defaultdict(deque)

    def look(self) -> None:
        """Restart or forget what has ended. Raises LinkLost for a process that the arm cannot do without."""
        for child in self._rig.dead():
            ended = f"{child.name} has ended: {child.complaint()}"
            number = self._count(child.name)
            if number <= child.plan.restarts:
                self._report(f"{ended}; it is started again ({number} of {child.plan.restarts} times a minute)")
                self._rig.restart(child.name)
            elif child.plan.vital:
                raise LinkLost(ended)
            else:
                self._go_without(child, ended)

    def _count(self, name: str) -> int:
        """Number of times it has ended within the window, this time included."""
        ends, now_s = self._ends[name], self._now_s()
        ends.append(now_s)
        while now_s - ends[0] > WINDOW_S:
            ends.popleft()
        return len(ends)

    def _go_without(self, child: Child, ended: str) -> None:
        self._report(f"{ended}; it ends too often and is not started again: the rest goes on without it")
        self._rig.forget(child.name)
