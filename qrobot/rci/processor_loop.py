"""The loop of one processor in real time: it waits for ticks, robots, devices and orders, and lets the monitor run.

It works out ticks from the common clock by itself: no other processor, and nothing that the planning program computes,
decides when its tasks are woken.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final

from qrobot.errors import RogueTask
from qrobot.rci.aside import HelperThreads
from qrobot.rci.common_clock import CommonClock
from qrobot.rci.monitor import Monitor
from qrobot.rci.readiness import Readiness, await_readable
from qrobot.rci.tcp import ANSWER_TIMEOUT_S
from qrobot.units import NS_PER_S

LOOK_S: Final = 0.25  # [A] a processor that waits for robots looks up so often, to see that one has fallen silent
Order = Callable[[], Any]


class ProcessorLoop:
    """Runs a monitor until it is told to end.

    Args:
        monitor: of the processor.
        clock: the common one.
        happened: called whenever tasks may have run.
    """

    def __init__(self, monitor: Monitor, clock: CommonClock, happened: Callable[[], object]) -> None:
        self.monitor = monitor
        monitor.aside = HelperThreads(self.ring)
        self._clock = clock
        self._happened = happened
        self._orders: deque[Order] = deque()
        self._doorbell = os.eventfd(0, os.EFD_CLOEXEC | os.EFD_NONBLOCK)
        self._open = threading.Lock()  # held while somebody rings, or the doorbell is given back
        self._over = self._closed = False

    def ring(self, order: Order) -> None:
        """Let the loop carry out an order, between two runs of tasks; a loop that was closed does not."""
        with self._open:
            if not self._closed:
                self._orders.append(order)
                os.eventfd_write(self._doorbell, 1)

    def end(self) -> None:
        """Let the loop end."""
        self.ring(lambda: setattr(self, "_over", True))

    def run(self, also: int | None = None, hear: Callable[[], object] = lambda: None) -> None:
        """Run. `also` is a further descriptor to wait for, and `hear` is called when it is readable."""
        while not self._over:
            with suppress(RogueTask):  # one that came when its task had just ended by itself
                ready = self._await(also)
                if also in ready.readable:
                    hear()
                self._turn(ready)

    def _await(self, also: int | None) -> Readiness:
        """The descriptors that have something to say, at the latest when the next tick is due."""
        watched = {self._doorbell, *self.monitor.sources} | ({also} if also is not None else set())
        return await_readable(watched, self._patience_s)

    @property
    def _patience_s(self) -> float | None:
        monitor, now_ns = self.monitor, self._clock.now_ns()
        if monitor.heard:
            return 0.0
        tick = self._clock.tick_at(now_ns) + 1 if monitor.waits_for_functions else monitor.next_tick
        if tick is not None:
            return min(max(0, self._clock.time_of(tick) - now_ns) / NS_PER_S, LOOK_S)
        return LOOK_S if monitor.attached else None

    def _turn(self, ready: Readiness) -> None:
        with suppress(BlockingIOError):
            os.eventfd_read(self._doorbell)
        while self._orders:
            self._orders.popleft()()
        monitor, now_ns = self.monitor, self._clock.now_ns()
        monitor.end_deaf(ready.closed)
        monitor.hear(ready.readable)
        monitor.pass_ticks(self._clock.tick_at(now_ns))
        monitor.ask_functions()
        monitor.run_ready()
        monitor.end_silent(now_ns, round(ANSWER_TIMEOUT_S * NS_PER_S), round(LOOK_S * NS_PER_S))
        self._happened()

    def close(self) -> None:
        """Give the doorbell back, when the loop has ended."""
        with self._open:
            self._closed = True
            os.close(self._doorbell)
