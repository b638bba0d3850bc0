"""The processor "host": a thread of the program beside the planning thread, with its interpreter and its memory."""

from __future__ import annotations

import ctypes
import threading
import time
from collections.abc import Callable, Collection
from contextlib import suppress
from typing import Any, Final

from qrobot.errors import LinkLost, QRobotError, RogueTask
from qrobot.rci.common_clock import CommonClock
from qrobot.rci.descriptor import TaskDescriptor, TaskState, TaskWord
from qrobot.rci.monitor import Monitor
from qrobot.rci.processor_loop import Order, ProcessorLoop
from qrobot.rci.thread_driver import PRIORITY
from qrobot.realtime.interpreter import InterpreterShare, prepare_interpreter
from qrobot.realtime.setup import set_fifo
from qrobot.units import NS_PER_S

WATCH_S: Final = 0.005  # [A] between two looks at how long tasks have been running
PATIENCE_S: Final = 1.0  # [A] with a task that was told to end and is inside a library that knows no exceptions
FAREWELL_S: Final = 8.0  # [A] with robots that come to rest, when the planning program is gone
_HELD: Final = (TaskState.ATTACHING, TaskState.READY, TaskState.ACTIVE, TaskState.RELEASING)


class HostThread:
    """One thread that runs tasks.

    Args:
        name: of the processor.
        clock: the common one.
        happened: called whenever tasks may have run.
    """

    def __init__(self, name: str, clock: CommonClock, happened: Callable[[], object]) -> None:
        self._clock = clock
        self._happened = happened
        self._loop = ProcessorLoop(Monitor(name, clock), clock, happened)
        self._thread = threading.Thread(target=self._run, name=f"rci-{name}", daemon=True)
        self._hung = False
        self._why = ""  # it runs no task any more
        self._share = InterpreterShare()
        prepare_interpreter()
        self._share.begin()
        self._thread.start()

    def _run(self) -> None:
        set_fifo(PRIORITY)
        try:
            self._loop.run()
        except BaseException as error:  # whatever it is, nobody else would tell the program
            self._give_up(error, f"it has failed ({type(error).__name__}: {error})")

    def order(self, order: str, *arguments: Any) -> None:
        """Let the monitor do something between two runs, and wait until it has. Raises what it raises."""
        self.begin(order, *arguments)()

    def begin(self, order: str, *arguments: Any) -> Callable[[], object]:
        """See `Processors.begin`."""
        if threading.current_thread() is self._thread:  # a control function changes its own attributes
            self._loop.monitor.obey(order, *arguments)
            return nothing_left
        if self._hung:
            refuse_start(order, self._why)
            return nothing_left  # its tasks have ended
        answer = Answer()
        if order == "power_off":
            self._power_off(answer, *arguments)
        else:
            self._loop.ring(lambda: answer.give(lambda: self._loop.monitor.obey(order, *arguments)))
        return lambda: answer.take(self._is_hopeless)

    def _power_off(self, answer: Answer, bits: int) -> None:
        """Greet robots aside, and go on with them between two runs."""
        monitor = self._loop.monitor
        monitor.aside(lambda: monitor.greet_left(bits), lambda left: answer.give(lambda: monitor.take_left(left.get())))

    def _is_hopeless(self) -> bool:
        """True when nobody will carry out an order; functions that an order calls are looked after meanwhile."""
        self.end_rogues(self._clock.now_ns())
        return self._hung or not self._thread.is_alive()

    def end_rogues(self, now_ns: int) -> None:
        """End a function that takes longer than it is allowed; all tasks, when it does not let itself be ended."""
        for runner in self._loop.monitor.runners:
            with runner.ending:
                late_ns = lateness(runner.td, now_ns)
                if late_ns > 0 and self._thread.ident is not None:
                    # Python's own way to interrupt a thread: raised before its next instruction.
                    ctypes.pythonapi.PyThreadState_SetAsyncExc(
                        ctypes.c_ulong(self._thread.ident), ctypes.py_object(RogueTask)
                    )
            if late_ns > PATIENCE_S * NS_PER_S and not self._hung:
                error = RogueTask(f"task {runner.td.name} does not return, and its processor with it")
                self._give_up(error, "a function that does not return keeps its thread")

    def _give_up(self, error: BaseException, why: str) -> None:
        """The thread never comes back: close the links of its robots, whose bridges then stop them."""
        self._hung, self._why = True, why
        for runner in self._loop.monitor.runners:
            if runner.td.state not in (TaskState.CREATED, TaskState.RELEASED, TaskState.ENDED):
                runner.abandon(error)
        self._happened()

    @property
    def hung(self) -> bool:
        """True when it never comes back, and its tasks have ended."""
        return self._hung

    def farewell(self, tds: Collection[TaskDescriptor]) -> None:
        """Bring the robots of its tasks to a controlled stop: the planning program is gone."""
        deadline = time.monotonic() + FAREWELL_S
        with suppress(QRobotError):
            self.order("release", sum(td.bit for td in tds), False)
        while any(td.state in _HELD for td in tds) and time.monotonic() < deadline:
            self.end_rogues(self._clock.now_ns())
            time.sleep(WATCH_S)

    def close(self) -> None:
        """End the thread, unless it never comes back."""
        if not self._hung:
            self._loop.end()
        while self._thread.is_alive() and not self._hung:
            self._thread.join(WATCH_S)
            self.end_rogues(self._clock.now_ns())
        if not self._thread.is_alive():
            self._loop.close()
        self._share.end()


def refuse_start(order: str, why: str) -> None:
    """Raise LinkLost when tasks are to be started, or robots to lose power, on a processor that does nothing more."""
    if order in ("attach", "power_off"):
        raise LinkLost(f"this processor runs no task any more, {why}: rci_close(), and create the tasks anew")


def nothing_left() -> None:
    """The wait for an order that is done."""


class Answer:
    """An order that one thread carries out and another one waits for."""

    def __init__(self) -> None:
        self._done = threading.Event()
        self._error: BaseException | None = None

    def give(self, order: Order) -> None:
        """Carry it out."""
        try:
            order()
        except Exception as error:  # it belongs to whoever waits
            self._error = error
        self._done.set()

    def take(self, hopeless: Callable[[], bool]) -> None:
        """Wait until it is carried out, or never will be. Raises what it raised."""
        while not self._done.wait(0.1) and not hopeless():
            pass
        if self._error is not None:
            raise self._error


def lateness(td: TaskDescriptor, now_ns: int) -> int:
    """Time by which a function that runs now has exceeded its own, ns; 0 or less when none has."""
    began_ns, allowed_ns = int(td.words[TaskWord.BEGAN_NS]), int(td.words[TaskWord.ALLOWED_NS])
    return now_ns - began_ns - allowed_ns if began_ns else 0
