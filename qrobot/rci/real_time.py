"""The processors of a program in real time, and the watch over tasks that run too long."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Final

from qrobot.errors import ConfigError
from qrobot.rci.common_clock import CommonClock
from qrobot.rci.descriptor import HOST
from qrobot.rci.host_thread import HostThread
from qrobot.rci.task_runner import current_task

START_LEAD_S: Final = 0.01  # [A] in which every processor hears that its tasks are to begin at one tick
WATCH_S: Final = 0.005  # between two looks at how long tasks have been running
_LOOK_S: Final = 0.002  # a waiting program looks up so often


class RealTimeProcessors:
    """Runs the tasks of a program by the monotonic clock.

    Attributes:
        clock: the common clock, which begins with the program.
    """

    def __init__(self) -> None:
        self.clock = CommonClock(time.monotonic_ns, epoch_ns=time.monotonic_ns())
        self._processors: dict[str, HostThread] = {}
        self._happened = threading.Event()
        self._over = threading.Event()
        self._watch = threading.Thread(target=self._watch_tasks, name="rci-watch", daemon=True)

    def stamp(self) -> int:
        """A number for each message, in their order."""
        return time.monotonic_ns()

    @property
    def start_lead(self) -> int:
        """Ticks from now to the first at which tasks that are activated together run."""
        return 1 + round(START_LEAD_S * self.clock.rate_hz)

    @property
    def ticks(self) -> int:
        """The newest tick."""
        return self.clock.ticks

    def add(self, processor: str) -> None:
        """Have a processor of that name. Raises ConfigError when there is none."""
        if processor not in self._processors:
            if processor != HOST:
                raise ConfigError(f"no processor {processor!r}: in real time there is {HOST!r}")
            self._processors[processor] = HostThread(processor, self.clock, self._happened.set)
        if not self._watch.is_alive():
            self._watch.start()

    def order(self, processor: str, order: str, *arguments: object) -> None:
        """Let the monitor of a processor do something, and wait until it has. Raises what it raises."""
        self._processors[processor].order(order, *arguments)

    def wait(self, predicate: Callable[[], object], look: Callable[[], object]) -> None:
        """Return when `predicate` is true, calling `look` as time passes. Raises what they raise."""
        if current_task() is not None:
            raise ConfigError("a control function must not wait: let it signal the program, or come again")
        while not predicate():
            self._happened.wait(_LOOK_S)
            self._happened.clear()
            look()

    def close(self) -> None:
        """End them."""
        self._over.set()
        for processor in self._processors.values():
            processor.close()

    def _watch_tasks(self) -> None:
        """End what takes longer than it is allowed."""
        while not self._over.wait(WATCH_S):
            for processor in list(self._processors.values()):
                processor.end_rogues(self.clock.now_ns())
