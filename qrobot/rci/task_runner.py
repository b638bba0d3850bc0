"""One control task on its processor: woken, run once for each wake-up, stopped when something goes wrong.

A task is a pair of functions. Without a robot they are called back to back; with one they stand around its I/O, as
`robot_cycle` says. They run to their end: nothing of the same processor comes between.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias, TypeVar

from qrobot.errors import ConfigError, LinkError, RogueTask
from qrobot.rci.aside import Aside, Outcome, at_once
from qrobot.rci.common_clock import CommonClock
from qrobot.rci.descriptor import TaskDescriptor, TaskState, TaskWord
from qrobot.rci.environment import OpenLink
from qrobot.rci.link import Link, check_welcome
from qrobot.rci.robot_cycle import CyclePhase, RobotCycle
from qrobot.rci.robot_data import RobotData
from qrobot.rci.schedule import ClockEntry
from qrobot.rci.tcp import TcpLink
from qrobot.units import NS_PER_US
from qrobot.wire import Command, State, Welcome
from qrobot.wire.vocabulary import LONGEST_PERIOD_US, SHORTEST_PERIOD_US

ControlFunction: TypeAlias = Callable[[TaskDescriptor], object]
T = TypeVar("T")

_current: ContextVar[TaskDescriptor | None] = ContextVar("current_task", default=None)


def current_task() -> TaskDescriptor | None:
    """The task whose function runs here, None in the planning program."""
    return _current.get()


def check_may_wait() -> None:
    """Raise ConfigError in a control function, which runs to its end."""
    if current_task() is not None:
        raise ConfigError("a control function must not wait: let it signal the program, or come again")


def nothing(_td: TaskDescriptor) -> None:
    """A control function that has nothing to do."""


@dataclass(frozen=True)
class ControlFunctions:
    """The two control functions of a task and its start-up function."""

    control1: ControlFunction = nothing
    control2: ControlFunction = nothing
    startup: ControlFunction = nothing


class RobotExchange:
    """Robot I/O with a read before the control function and a send behind it, over any link."""

    def __init__(self, link: Link) -> None:
        self.link = link
        self._command: Command | None = None  # on virtual time, until the next read

    def read(self) -> State | None:
        """The newest STATE; None in real time where something else has come, or a part of one. Raises LinkError."""
        if isinstance(self.link, TcpLink):
            return self.link.take_state()
        command, self._command = self._command, None
        return self.link.exchange(command)

    def fileno(self) -> int:
        """Descriptor that becomes readable when a STATE comes. Raises LinkError, ConfigError on virtual time."""
        if not isinstance(self.link, TcpLink):
            raise ConfigError("a robot on virtual time cannot be had in real time")
        return self.link.fileno()

    @property
    def has_state(self) -> bool:
        """See `TcpLink`; false on virtual time."""
        return isinstance(self.link, TcpLink) and self.link.has_state

    def send(self, command: Command) -> None:
        """Answer it. Raises LinkError."""
        if isinstance(self.link, TcpLink):
            self.link.send(command)
        else:
            self._command = command


class Greeting(NamedTuple):
    """A robot that was greeted, and what its bridge said."""

    link: Link
    welcome: Outcome[Welcome]


class TaskRunner:
    """Runs one task.

    Args:
        td: its descriptor.
        clock: the common one.
        open_link: makes the way to its robot; None for a task without one.
        aside: opens and closes it, which may take seconds.

    Attributes:
        functions: what it runs.
        entry: interval and offset on the clock, None without.
        wakeup: wakes it when it returns true, None without.
        device: becomes readable when the task, or its wake-up function, is to be called; None without.
        next_ns: on virtual time, when its robot's next sample is.
        heard_ns: when its robot was heard last.
    """

    def __init__(
        self, td: TaskDescriptor, clock: CommonClock, open_link: OpenLink | None = None, aside: Aside = at_once
    ) -> None:
        self.td, self._clock, self._open_link, self._aside = td, clock, open_link, aside
        self.functions = ControlFunctions()
        self.entry: ClockEntry | None = None
        self.wakeup: Callable[[], object] | None = None
        self.device: int | None = None
        self.next_ns: int | None = None
        self.heard_ns = 0
        self.ending = threading.Lock()  # held while a function ends, or is ended from outside
        self.port: RobotExchange | None = None
        self._cycle: RobotCycle | None = None
        self._active_from = 0
        self._started_up = False
        self._state: State | None = None  # the newest, to be answered when something goes wrong

    # ----------------------------------------------------------------------------------------------------- attachment

    @property
    def attached(self) -> bool:
        """True when it holds a robot."""
        return self.port is not None

    def attach(self) -> None:
        """Call its start-up function, once in its life, and greet its robot, if it has one."""
        self.td.begin()
        self._enter(TaskState.ATTACHING)
        with self.guarded():
            if not self._started_up:
                self.watched(lambda: self.functions.startup(self.td))
                self._started_up = True
            if self._open_link is None or self.td.robot is None:
                self._enter(TaskState.READY)
            else:
                self._greet(self.td.robot, self._open_link(self._period_us()))

    def _greet(self, data: RobotData, link: Link) -> None:
        starts = self.td.starts

        def greeted(welcome: Outcome[Welcome]) -> None:
            if self.td.state is not TaskState.ATTACHING or self.td.starts != starts:  # nobody waits for it any more
                self._aside(lambda: link.close(f"task {self.td.name} was released"), lambda _: None)
                return
            with self.guarded():
                self._take_robot(data, link, welcome.get())

        self._aside(lambda: _opened(link), greeted)

    def _period_us(self) -> int:
        if self.entry is None:
            return 0
        period_us = self._clock.whole_us(self.entry.interval)
        if not SHORTEST_PERIOD_US <= period_us <= LONGEST_PERIOD_US:
            raise ConfigError(f"task {self.td.name}: a robot is sampled every 1 to 100 ms, not {period_us / 1e3:g} ms")
        return period_us

    def _take_robot(self, data: RobotData, link: Link, welcome: Welcome) -> None:
        self.port = RobotExchange(link)
        check_welcome(welcome, data.robot, f"task {self.td.name}")
        self._cycle = RobotCycle(self.td, data, welcome.period_us * 1e-6)
        self._set_next_sample(welcome)

    def _set_next_sample(self, welcome: Welcome) -> None:
        self._period_ns = welcome.period_us * NS_PER_US
        self.next_ns = self.heard_ns = self._clock.now_ns()
        self.plan_sample()

    def plan_sample(self) -> None:
        """Work out when the robot is sampled next, on virtual time."""
        if self.next_ns is None:
            return
        if self.entry is None:
            self.next_ns += self._period_ns
        else:
            self.next_ns = self._clock.time_of(self.entry.first_after(self._clock.tick_at(self.next_ns)))

    # ------------------------------------------------------------------------------------------------------------ runs

    def activate(self, after: int) -> None:
        """Run its control functions from the first wake-up behind tick `after` on."""
        if self.td.state is TaskState.READY:  # it may have ended since
            self.td.words[TaskWord.SERVED] = self.td.words[TaskWord.WOKEN]
            self._active_from = after + 1
            self._enter(TaskState.ACTIVE)

    def release(self, power_off: bool) -> None:
        """Run them no more; a robot comes to a controlled stop and is let go."""
        if self._cycle is not None:
            self._cycle.stop(power_off)
            self._enter(TaskState.RELEASING)
        elif self.td.state not in (TaskState.RELEASING, TaskState.ENDED):  # otherwise its link is being closed
            self._enter(TaskState.RELEASED)

    def greet_left(self) -> Greeting | None:
        """Greet a robot that was let go with power; None for any other. It takes time, and changes nothing here."""
        if self.attached or self._open_link is None or not self.td.left_with_power:
            return None
        link = self._open_link(0)
        return Greeting(link, Outcome(lambda: _opened(link)))

    def power_off(self, greeting: Greeting) -> None:
        """Take a robot that was let go again, to switch its power off. Raises what keeps it from that."""
        welcome = greeting.welcome.get()
        if self.attached or self.td.robot is None:  # it was started again meanwhile
            greeting.link.close("its power stays on")
            return
        try:
            self._take_robot(self.td.robot, greeting.link, welcome)
        except BaseException as error:
            self.port = self._cycle = None
            greeting.link.close(str(error))
            raise
        self.release(power_off=True)

    def wake(self, times: int = 1) -> None:
        """Count wake-ups."""
        words = self.td.words
        words[TaskWord.MISSED] += times if self.td.run_count else times - 1
        words[TaskWord.WOKEN] += times

    @property
    def runnable(self) -> bool:
        """True when it has been woken, and may run."""
        return self.td.run_count > 0 and (self.attached or self.td.active)

    def run(self) -> None:
        """Answer one wake-up; with a robot all of them, for a sample is answered once."""
        words = self.td.words
        with self.guarded():
            if self._cycle is None:
                self._call_both()
            else:
                self._sample(self._cycle)
        words[TaskWord.SERVED] = words[TaskWord.WOKEN] if self.attached else words[TaskWord.SERVED] + 1

    def _call_both(self) -> None:
        self._call(self.functions.control1)
        self._call(self.functions.control2)
        self.td.words[TaskWord.RUNS] += 1

    def _call(self, function: ControlFunction) -> None:
        """Run a control function, and note how long it took."""
        words, began_ns = self.td.words, self._clock.now_ns()
        self.watched(lambda: function(self.td))
        words[TaskWord.LONGEST_NS] = max(words[TaskWord.LONGEST_NS], self._clock.now_ns() - began_ns)

    def watched(self, call: Callable[[], T]) -> T:
        """Call any function of the program's; as long as it runs, the descriptor tells since when."""
        words = self.td.words
        words[TaskWord.BEGAN_NS] = self._clock.now_ns()
        try:
            return call()
        finally:
            with self.ending:
                words[TaskWord.BEGAN_NS] = 0

    def _sample(self, cycle: RobotCycle) -> None:
        if self.port is None:
            return
        if (state := self.port.read()) is None:
            return
        self._state, self.heard_ns = state, self._clock.now_ns()
        self._count_left_out(cycle)
        follows = cycle.phase is CyclePhase.FOLLOWING
        runs = follows and self.td.active and self._clock.ticks >= self._active_from
        control = (lambda: self._call(self.functions.control1)) if runs else None
        self.port.send(cycle.step(state, self.port.link.now_ns(), control))
        self._state = None
        self._see(cycle.phase)
        if runs and self.td.active:
            self._call(self.functions.control2)
            self.td.words[TaskWord.RUNS] += 1

    def _count_left_out(self, cycle: RobotCycle) -> None:
        """Samples of the robot that nobody took are wake-ups that were missed."""
        if left_out := cycle.left_out:
            self.td.words[TaskWord.MISSED] += left_out
            self.td.words[TaskWord.WOKEN] += left_out
            cycle.left_out = 0

    def _see(self, phase: CyclePhase) -> None:
        if phase is CyclePhase.FOLLOWING and self.td.state is TaskState.ATTACHING:
            self._enter(TaskState.READY)
        elif phase is CyclePhase.LEFT:
            self._let_go(f"task {self.td.name} was released")

    # ---------------------------------------------------------------------------------------------------- its bad end

    @contextmanager
    def guarded(self) -> Iterator[None]:
        """End the task with what is raised inside, and bring its robot to a controlled stop."""
        token = _current.set(self.td)
        try:
            yield
        except (Exception, SystemExit) as error:
            self.end(self._rogue() if isinstance(error, RogueTask) else error)
        finally:
            self.td.words[TaskWord.BEGAN_NS] = 0  # also when it was ended while it was ending
            _current.reset(token)

    def _rogue(self) -> RogueTask:
        allowed_ms = self.td.words[TaskWord.ALLOWED_NS] * 1e-6
        return RogueTask(
            f"task {self.td.name} ran for more than the {allowed_ms:g} ms it is allowed and was ended: "
            "make it shorter, or allow it more by rci_timeout()"
        )

    def end(self, error: BaseException) -> None:
        """End it before its time: stop its robot, remember why."""
        if self.td.error is None:
            self.td.error = error
        if self._cycle is None or isinstance(error, LinkError):
            self._let_go(str(error))  # a bridge that hears a goodbye, or nothing any more, stops the arm
            return
        self._enter(TaskState.RELEASING)
        self._cycle.stop()
        self._send_stop(self._cycle)

    def abandon(self, error: BaseException) -> None:
        """End it from another thread, because its own never comes back: the bridge stops its robot."""
        self.td.error = self.td.error or error
        if self.port is not None:
            self.port.link.close(str(error))
        self._enter(TaskState.ENDED)

    def _send_stop(self, cycle: RobotCycle) -> None:
        state, self._state = self._state, None
        if state is None or self.port is None:
            return  # the sample was answered; the next answer says it
        try:
            self.port.send(cycle.answer(state, self.port.link.now_ns()))
            self._see(cycle.phase)
        except Exception as error:  # the link as well
            self._let_go(str(error))

    def _let_go(self, reason: str) -> None:
        """Rest, when the link of its robot is closed."""
        port, self.port = self.port, None
        self._cycle = self.next_ns = None
        self._enter(TaskState.RELEASING)
        if port is None:
            self._rest()
        else:
            self._aside(lambda: port.link.close(reason), lambda _: self._rest())

    def _rest(self) -> None:
        if self.td.state is TaskState.RELEASING:  # it may have been given up meanwhile
            self._enter(TaskState.RELEASED if self.td.error is None else TaskState.ENDED)

    def _enter(self, state: TaskState) -> None:
        self.td.words[TaskWord.STATE] = state


def _opened(link: Link) -> Welcome:
    """Greet a robot; a link on which that fails is closed. Raises what `Link.open` raises."""
    try:
        return link.open()
    except BaseException as error:
        link.close(str(error))
        raise
