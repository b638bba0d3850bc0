"""The processors "compiled": a thread of the program that never waits for the interpreter, for one task each."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import ConfigError, RogueTask
from qrobot.rci.common_clock import CommonClock
from qrobot.rci.compiled import no_function, pointer_to, refuse_order, refuse_task, run_control
from qrobot.rci.descriptor import TaskDescriptor, TaskState, TaskWord
from qrobot.rci.host_thread import PATIENCE_S, lateness, refuse_start
from qrobot.rci.schedule import ClockEntry
from qrobot.rci.task_runner import ControlFunctions, nothing
from qrobot.rci.thread_driver import PRIORITY
from qrobot.realtime.setup import set_fifo, tighten_timers
from qrobot.units import NS_PER_S


class CompiledThread:
    """Runs one task of compiled functions; its thread lives as long as the task is active.

    Args:
        name: of the processor.
        clock: the common one.
        memory_of: the numbers that a task works on.
        happened: called when the task has ended.
    """

    def __init__(
        self,
        name: str,
        clock: CommonClock,
        memory_of: Callable[[TaskDescriptor], Floats],
        happened: Callable[[], object],
    ) -> None:
        self._name, self._clock, self._memory_of, self._happened = name, clock, memory_of, happened
        self._td: TaskDescriptor | None = None
        self._functions = ControlFunctions()
        self._entry: ClockEntry | None = None
        self._over = np.zeros(1, np.int64)
        self._thread: threading.Thread | None = None
        self._started_up = self._hung = False

    def order(self, order: str, *arguments: Any) -> None:
        """Do one of the orders of a monitor. Raises ConfigError for those that only an interpreter can do."""
        refuse_order(self._name, order)
        if self._hung:
            refuse_start(order, "a function that does not return keeps its thread")
        else:
            getattr(self, f"_{order}")(*arguments)

    def begin(self, order: str, *arguments: Any) -> Callable[[], object]:
        """See `Processors.begin`; it is done while it is waited for: no robot is there to be stopped."""
        return lambda: self.order(order, *arguments)

    def _add(self, td: TaskDescriptor, _open_link: object) -> None:
        refuse_task(self._name, td, alone=self._td is None)
        self._td = td

    def _set_functions(self, _bit: int, functions: ControlFunctions) -> None:
        for function in (functions.control1, functions.control2):
            if function is not nothing:
                pointer_to(function, self._task.name)
        self._functions = functions
        self._begin_again()

    def _set_clock(self, _bit: int, interval: int, offset: int) -> None:
        self._entry = ClockEntry(interval, offset)
        self._begin_again()

    def _attach(self, _bits: int) -> None:
        """Call the start-up function, and have the loop ready."""
        td = self._task
        if not self._started_up:
            self._functions.startup(td)
            self._started_up = True
        self._over[0] = 1
        self._loop(0)
        td.words[TaskWord.STATE] = TaskState.READY

    def _activate(self, _bits: int, after: int) -> None:
        self._task.words[TaskWord.STATE] = TaskState.ACTIVE
        self._begin(after)

    def _release(self, _bits: int, _power_off: bool) -> None:
        self._stop()
        if not self._hung:
            self._task.words[TaskWord.STATE] = TaskState.RELEASED

    # ---------------------------------------------------------------------------------------------------------- thread

    @property
    def _task(self) -> TaskDescriptor:
        if self._td is None:
            raise ConfigError(f"processor {self._name} has no task")
        return self._td

    def _begin(self, after: int) -> None:
        if self._entry is not None:
            self._over[0] = 0
            first = self._entry.first_after(after)
            self._thread = threading.Thread(target=self._run, args=(first,), name=f"rci-{self._name}", daemon=True)
            self._thread.start()

    def _begin_again(self) -> None:
        if self._td is not None and self._td.active:
            self._stop()
            self._begin(self._clock.ticks)

    def _run(self, tick: int) -> None:
        set_fifo(PRIORITY)
        tighten_timers()
        try:
            self._loop(tick)
        except Exception as error:  # of the compiled functions
            self._end(error)

    def _loop(self, tick: int) -> None:
        td, functions, clock = self._task, self._functions, self._clock
        second = no_function if functions.control2 is nothing else functions.control2
        pointers = pointer_to(functions.control1, td.name), pointer_to(second, td.name)
        interval = 1 if self._entry is None else self._entry.interval
        addresses = pointers[0].raising_address, pointers[1].raising_address
        run_control(
            td.words, self._over, self._memory_of(td), *addresses, clock.rate_hz, clock.epoch_ns, interval, tick
        )

    def _stop(self) -> None:
        if self._thread is not None:
            self._over[0] = 1
            self._thread.join(PATIENCE_S)
            if self._thread.is_alive():
                self._give_up()
            self._thread = None
            self._task.words[TaskWord.SERVED] = self._task.words[TaskWord.WOKEN]

    # --------------------------------------------------------------------------------------------------- looking after

    def end_rogues(self, now_ns: int) -> None:
        """Tell of a function that does not return; compiled code cannot be interrupted."""
        if self._td is not None and lateness(self._td, now_ns) > PATIENCE_S * NS_PER_S and not self._hung:
            self._give_up()

    def _give_up(self) -> None:
        self._hung = True
        self._over[0] = 1
        name = self._task.name
        self._end(RogueTask(f"task {name} does not return: its compiled function keeps processor {self._name}"))

    def _end(self, error: Exception) -> None:
        """End the task before its time: remember why, tell the program."""
        td = self._task
        td.error = td.error or error
        if not self._hung:
            td.words[TaskWord.BEGAN_NS] = 0
        td.words[TaskWord.STATE] = TaskState.ENDED
        self._happened()

    def close(self) -> None:
        """End the thread, unless it never comes back."""
        if not self._hung:
            self._stop()
