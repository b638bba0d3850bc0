"""All processors of RCI in the program's own thread, on virtual time: exact and the same in every run.

Their events are ticks of the common clock and samples of robots. `program_time` goes from one to the next, beside the
arms of RCCL and the machines of ARCL that the program may have.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import count

import numpy as np

from qrobot.arrays import Words
from qrobot.rci.common_clock import CommonClock
from qrobot.rci.compiled_monitor import CompiledMonitor
from qrobot.rci.descriptor import HOST
from qrobot.rci.monitor import Monitor
from qrobot.rci.processor_image import KnownArea, TaskNumbers
from qrobot.rci.processor_names import check_processor_name, is_compiled
from qrobot.rci.program_time import Rank, Turn, program_time
from qrobot.rci.task_runner import check_may_wait


class VirtualProcessors:
    """Runs the monitors of a program.

    Attributes:
        clock: the common clock, which stands at 0 before its first tick.
    """

    start_lead = 0  # ticks from now to the first one at which tasks that are activated together run

    def __init__(self) -> None:
        self._time = program_time()
        self._began = False
        self._tick = -1  # the newest that has passed
        self._monitors: dict[str, Monitor] = {}
        self._ranks: dict[int, Rank] = {}  # by bit
        self._stamps = count()
        self._numbers = TaskNumbers()
        self.clock = CommonClock(lambda: self._time.now_ns)

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
        for runner in self._monitors[processor].runners:
            if runner.td.bit not in self._ranks:
                self._ranks[runner.td.bit] = self._time.rank(self._place(processor), runner.td.priority)
                self._time.reorder()

    def begin(self, processor: str, order: str, *arguments: object) -> Callable[[], object]:
        """See `Processors.begin`: it is done at once."""
        self.order(processor, order, *arguments)
        return lambda: None

    def _place(self, processor: str) -> int:
        """The place of a processor in the order of all, of which "host" is the first."""
        others = [name for name in self._monitors if name != HOST]
        return 0 if processor == HOST else 1 + others.index(processor)

    @property
    def ticks(self) -> int:
        """The newest tick that has passed, -1 before the first."""
        return self._tick

    def wait(self, predicate: Callable[[], object], look: Callable[[], object]) -> None:
        """Let time pass until `predicate` is true, calling `look` at each event. Raises what they raise."""
        check_may_wait()
        self._begin()
        with self._time.waiting():
            while not predicate():
                self._time.advance()
                look()

    def _begin(self) -> None:
        """Let time pass from now on; the clock's first tick is now."""
        if self._began:
            return
        self._began, self.clock.epoch_ns = True, self._time.now_ns
        self._time.join(self)

    @property
    def next_ns(self) -> int:
        """See `TimeMember.next_ns`."""
        samples = (runner.next_ns for m in self._monitors.values() for runner in m.attached)
        return min([self.clock.time_of(self._tick + 1), *(at for at in samples if at is not None)])

    def come_to(self, now_ns: int) -> None:
        """See `TimeMember.come_to`: wake the tasks that are due."""
        if now_ns >= self.clock.time_of(self._tick + 1):
            self._tick += 1
            for monitor in self._monitors.values():
                monitor.pass_ticks(self._tick)
                monitor.ask_functions()
                monitor.hear_devices()
        for monitor in self._monitors.values():
            monitor.wake_sampled(now_ns)

    @property
    def turns(self) -> list[Turn]:
        """See `TimeMember.turns`."""
        return [Turn(self._ranks[r.td.bit], r) for m in self._monitors.values() for r in m.runners]

    def words(self, n: int) -> Words:
        """Zeroed memory that all processors reach."""
        return np.zeros(n, np.int64)

    def seal(self, _tasks: object, areas: list[KnownArea], _environment: object) -> None:
        """All tasks and memory are known."""
        self._numbers.know(areas)
        self._begin()

    def close(self) -> None:
        """Let no more time pass for them."""
        self._time.leave(self)
