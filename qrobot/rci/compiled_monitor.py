"""A processor "compiled" on virtual time: the same functions in the same order, called from the program's thread."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from qrobot.arrays import Floats
from qrobot.rci.common_clock import CommonClock
from qrobot.rci.compiled import pointer_to, refuse_order, refuse_task
from qrobot.rci.descriptor import TaskDescriptor
from qrobot.rci.environment import OpenLink
from qrobot.rci.monitor import Monitor
from qrobot.rci.task_runner import ControlFunction, ControlFunctions, nothing


class CompiledMonitor(Monitor):
    """The monitor of one compiled task.

    Args:
        name: of the processor.
        clock: the common one.
        memory_of: the numbers that a task works on.
    """

    def __init__(self, name: str, clock: CommonClock, memory_of: Callable[[TaskDescriptor], Floats]) -> None:
        super().__init__(name, clock)
        self._memory_of = memory_of

    def obey(self, order: str, *arguments: Any) -> None:
        """Do what compiled tasks can. Raises ConfigError for the rest."""
        refuse_order(self.name, order)
        super().obey(order, *arguments)

    def add(self, td: TaskDescriptor, open_link: OpenLink | None) -> None:
        """Run a task of this descriptor. Raises ConfigError for a second one, or one with a robot."""
        refuse_task(self.name, td, alone=not self.runners)
        super().add(td, open_link)

    def set_functions(self, bit: int, functions: ControlFunctions) -> None:
        """Give it its functions. Raises ConfigError for those that are not compiled."""
        control1, control2 = (self._called(function) for function in (functions.control1, functions.control2))
        super().set_functions(bit, ControlFunctions(control1, control2, functions.startup))

    def _called(self, function: ControlFunction) -> ControlFunction:
        """A compiled function as the interpreter calls it."""
        if function is nothing:
            return function
        pointer_to(function, self.name)
        compiled: Any = function
        return lambda td: compiled(self._clock.ticks, self._memory_of(td))
