"""All processors of a program in its own thread, on virtual time: exact and the same in every run.

Time stands still until the program waits. It then goes from one event to the next: a tick of the common clock, or a
sample of a robot. What is due at one instant runs in the order of processors, priorities and creation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import count

import numpy as np

from qrobot.arrays import Words
from qrobot.errors import ConfigError
from qrobot.rci.common_clock import CommonClock
from qrobot.rci.compiled_monitor import CompiledMonitor
from qrobot.rci.monitor import Monitor
from qrobot.rci.processor_image import KnownArea, TaskNumbers
from qrobot.rci.processor_names import check_processor_name, is_compiled
from qrobot.rci.task_runner import current_task


class VirtualProcessors:
    """Runs the monitors of a program.

    Attributes:
        clock: the common clock, which stands at 0 before its first tick.
    """

    start_lead = 0  # ticks from now to the first one at which tasks that are activated together run

    def __init__(self) -> None:
        self._now_ns = 0
        self._tick = -1  # the newest that has passed
        self._monitors: dict[str, Monitor] = {}
        self._stamps = count()
        self._numbers = TaskNumbers()
        self.clock = CommonClock(lambda: self._now_ns)

    def stamp(self) -> int:
        """A number for each message, in their order."""
        return next(self._stamps)

    def add(self, processor: str) -> None:
        """Have a processor of that name, which needs not exist. Raises ConfigError when it cannot."""
        check_processor_name(processor)
        if processor not in self._monitors:
            self._monitors[processor] = (
                CompiledMonitor(processor, self.clock, self._numbers.of)
                if is_compiled(processor)
                else Monitor(processor, self.clock)
            )

    def order(self, processor: str, order: str, *arguments: object) -> None:
        """Let the monitor of a processor do something. Raises what it raises."""
        self._monitors[processor].obey(order, *arguments)

    @property
    def ticks(self) -> int:
        """The newest tick that has passed, -1 before the first."""
        return self._tick

    def wait(self, predicate: Callable[[], object], look: Callable[[], object]) -> None:
        """Let time pass until `predicate` is true, calling `look` at each event. Raises what they raise."""
        if current_task() is not None:
            raise ConfigError("a control function must not wait: let it signal the program, or come again")
        while not predicate():
            self._advance()
            look()

    def _advance(self) -> None:
        """Go to the next event."""
        tick_ns = self.clock.time_of(self._tick + 1)
        samples = (runner.next_ns for m in self._monitors.values() for runner in m.attached)
        self._now_ns = min([tick_ns, *(at for at in samples if at is not None)])
        if self._now_ns == tick_ns:
            self._tick += 1
            self._pass_tick(self._monitors.values())
        for monitor in self._monitors.values():
            monitor.wake_sampled(self._now_ns)
            monitor.run_ready()

    def _pass_tick(self, monitors: Iterable[Monitor]) -> None:
        for monitor in monitors:
            monitor.pass_ticks(self._tick)
            monitor.ask_functions()
            monitor.hear_devices()

    def words(self, n: int) -> Words:
        """Zeroed memory that all processors reach."""
        return np.zeros(n, np.int64)

    def seal(self, _tasks: object, areas: list[KnownArea], _environment: object) -> None:
        """All tasks and memory are known."""
        self._numbers.know(areas)

    def close(self) -> None:
        """Nothing runs by itself."""
