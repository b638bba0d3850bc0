"""A program of RCI: the planning task, its control tasks, and what they share."""

from __future__ import annotations

import atexit
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Final, Protocol

import numpy as np

from qrobot.arrays import Words
from qrobot.errors import ConfigError, QRobotError, letting_go, raise_first
from qrobot.rci.bad_end import at_bad_end, interpreter_ends_well, stop_all, stop_each
from qrobot.rci.common_clock import CommonClock, checked_rate
from qrobot.rci.descriptor import AREA_WORDS, HOST, MOST_TASKS, PARENT, TaskDescriptor, TaskState, TaskWord
from qrobot.rci.environment import Environment, link_maker
from qrobot.rci.forked_child import keep_from_children
from qrobot.rci.processor_image import KnownArea, KnownTask, SharedVariable
from qrobot.rci.readiness import check_open
from qrobot.rci.real_time import RealTimeProcessors
from qrobot.rci.robot_data import KnownRobot, RobotTable
from qrobot.rci.schedule import check_interval
from qrobot.rci.task_runner import ControlFunction, ControlFunctions
from qrobot.rci.task_table import ALL, Bytes, SharedArea, SharedProgram, TaskTable
from qrobot.rci.virtual_time import VirtualProcessors
from qrobot.units import NS_PER_S

LONGEST_S: Final = 3600.0
_RUNNING: Final = (TaskState.ATTACHING, TaskState.READY, TaskState.ACTIVE, TaskState.RELEASING)


class HasFileno(Protocol):
    """A file, a socket, a pipe."""

    def fileno(self) -> int:
        """Its descriptor."""


class Processors(Protocol):
    """Processors on which the tasks of a program run, and their clock.

    Attributes:
        clock: the common one.
    """

    clock: CommonClock

    @property
    def start_lead(self) -> int:
        """Ticks from now to the first at which tasks that are activated together run."""

    @property
    def ticks(self) -> int:
        """The newest tick that has passed."""

    def stamp(self) -> int:
        """A number for each message, in their order."""

    def add(self, processor: str) -> None:
        """Have a processor of that name. Raises ConfigError when it cannot be had."""

    def order(self, processor: str, order: str, *arguments: object) -> None:
        """Let its monitor do something."""

    def begin(self, processor: str, order: str, *arguments: object) -> Callable[[], object]:
        """The same, without a wait; gives what waits until it is done, and raises what `order` raises."""

    def words(self, n: int) -> Words:
        """Zeroed memory that all of them reach."""

    def seal(self, tasks: list[KnownTask], areas: list[KnownArea], environment: Environment) -> None:
        """Get ready to run, now that all tasks and memory are known."""

    def wait(self, predicate: Callable[[], object], look: Callable[[], object]) -> None:
        """Return when `predicate` is true, calling `look` as time passes. Raises what they raise."""

    def close(self) -> None:
        """End them."""


class RciProgram:
    """One program: the calls of the papers as methods.

    Args:
        environment: its robots and its time.

    Attributes:
        parent: descriptor of the planning task.
        table: what its tasks share.
        robots: names that connect a task to a robot.
    """

    def __init__(self, environment: Environment) -> None:
        self._environment = environment
        self._processors: Processors = VirtualProcessors() if environment.virtual_time else RealTimeProcessors()
        self.table = TaskTable(self._processors.stamp)
        self.robots = RobotTable()
        self.parent = TaskDescriptor("parent", PARENT, HOST, self._processors.words(AREA_WORDS))
        self.table.add(self.parent)
        self._tasks: list[TaskDescriptor] = []
        self._functions: dict[int, ControlFunctions] = {}
        self._robots_of: dict[int, KnownRobot | None] = {}
        self._areas: list[KnownArea] = []
        self._sealed = False
        self._told: set[int] = set()  # tasks whose end the program has heard of
        atexit.register(self._at_exit)
        _open.append(self)
        keep_from_children(self)

    def forget_in_child(self) -> None:
        """See `Owned`: its tasks are the parent's."""
        atexit.unregister(self._at_exit)
        _open[:] = [other for other in _open if other is not self]

    # -------------------------------------------------------------------------------------------------------- creation

    def create(self, name: str, processor: str | None, priority: int) -> TaskDescriptor:
        """A task, not active yet; see `rci_create`."""
        self._check_not_sealed(f"task {name!r}")
        self._check_task(name, processor, priority)
        known, where = self.robots.find(name), processor or HOST
        data = None if known is None else known.data()
        self._processors.add(where)
        bit = PARENT << (len(self._tasks) + 1)
        td = TaskDescriptor(name, bit, where, self._processors.words(AREA_WORDS), data, priority)
        self._tasks.append(td)
        self.table.add(td)
        self._robots_of[td.bit] = known
        self._processors.order(where, "add", td, link_maker(self._environment, known, data))
        return td

    def _check_task(self, name: object, processor: object, priority: object) -> None:
        """Raise ConfigError for what cannot make a task, before anything of it is kept."""
        if not isinstance(name, str) or not name or not name.isprintable() or name == self.parent.name:
            raise ConfigError(f"{name!r} cannot name a task")
        if any(td.name == name for td in self._tasks):
            raise ConfigError(f"task {name!r}: there is one of that name already; take another name")
        if len(self._tasks) == MOST_TASKS:
            raise ConfigError(f"task {name!r}: there are {MOST_TASKS} already, the most that a program can have")
        if processor is not None and not isinstance(processor, str):
            raise ConfigError(f"task {name!r}: a processor has a name, as 'host' or 'aux', not {processor!r}")
        if not isinstance(priority, int) or isinstance(priority, bool):
            raise ConfigError(f"task {name!r}: a priority is a whole number, not {priority!r}")

    def _check_not_sealed(self, what: str) -> None:
        if self._sealed:
            raise ConfigError(f"{what}: create all tasks and shared memory before the first rci_start()")

    def share_memory(
        self, label: str, size: int, host: TaskDescriptor | None, access: int, variable: SharedVariable | None = None
    ) -> Bytes:
        """A region of memory; see `rci_shared_memory`."""
        self._check_not_sealed(f"shared memory {label!r}")
        if not isinstance(size, int) or isinstance(size, bool) or not 0 < size <= 1 << 30:
            raise ConfigError(f"shared memory {label!r}: 1 to {1 << 30} bytes, not {size!r}")
        self.table.of(access, f"shared memory {label!r}")
        memory = self._processors.words(-(-size // 8)).view(np.uint8)[:size]
        area = SharedArea(label, memory, access | PARENT | (0 if host is None else host.bit))
        self.table.share(area)
        self._areas.append(KnownArea(area, variable))
        return memory

    def _seal(self) -> None:
        """All tasks and memory are known from now on."""
        if not self._sealed:
            tasks = [KnownTask(td, self._robots_of.get(td.bit)) for td in (self.parent, *self._tasks)]
            self._processors.seal(tasks, self._areas, self._environment)
        self._sealed = True

    def set_clock_rate(self, rate_hz: int) -> None:
        """Ticks a second of the common clock; see `rci_clock`."""
        self._check_not_sealed("the clock's rate")
        self._processors.clock.rate_hz = checked_rate(rate_hz)

    # ------------------------------------------------------------------------------------------- attributes of a task

    def control(self, td: TaskDescriptor, functions: ControlFunctions) -> None:
        """Set the functions that it runs; see `rci_control`."""
        for function in (functions.control1, functions.control2, functions.startup):
            if not callable(function):
                raise ConfigError(f"task {td.name}: {function!r} is no function of its descriptor")
        self._order(td, "set_functions", functions)
        self._functions[td.bit] = functions

    def on_clock(self, td: TaskDescriptor, interval: int, offset: int) -> None:
        """Wake it by the clock; see `rci_onclock`."""
        check_interval(f"task {td.name}", interval, offset)
        self._order(td, "set_clock", interval, offset)

    def on_function(self, td: TaskDescriptor, wakeup: Callable[[], object]) -> None:
        """Wake it by a function; see `rci_onfunction`."""
        if td.robot is not None:
            raise ConfigError(f"task {td.name} is woken by its robot: give a task without one the function")
        if not callable(wakeup):
            raise ConfigError(f"task {td.name}: {wakeup!r} is no function")
        self._order(td, "set_wakeup", wakeup)

    def on_device(self, td: TaskDescriptor, device: int | HasFileno) -> None:
        """Wake it, or ask its wake-up function, when a device is readable; see `rci_device_interrupt`."""
        if td.robot is not None:
            raise ConfigError(f"task {td.name} is woken by its robot: give a task without one the device")
        try:
            descriptor = device if isinstance(device, int) else device.fileno()
            check_open(descriptor)
        except (OSError, ValueError, OverflowError, AttributeError, TypeError) as error:
            raise ConfigError(f"task {td.name}: {device!r} is no device that can be waited for: {error}") from error
        self._order(td, "set_device", descriptor)

    def allow(self, td: TaskDescriptor, seconds: float) -> None:
        """Set how long each of its functions may take; see `rci_timeout`."""
        if not (isinstance(seconds, (int, float)) and 0.001 <= seconds <= LONGEST_S):
            raise ConfigError(f"task {td.name}: 0.001 to {LONGEST_S:g} s may be allowed, not {seconds!r}")
        td.words[TaskWord.ALLOWED_NS] = round(seconds * NS_PER_S)

    def trigger(self, td: TaskDescriptor, interval: int, offset: int, function: ControlFunction) -> None:
        """Call a function for it by the clock; see `rci_trigger`."""
        check_interval(f"trigger of task {td.name}", interval, offset)
        if not callable(function):
            raise ConfigError(f"trigger of task {td.name}: {function!r} is no function")
        self._order(td, "set_trigger", interval, offset, function)

    def _order(self, td: TaskDescriptor, order: str, *arguments: object) -> None:
        if self.table.find(td.name) is not td or td is self.parent:
            raise ConfigError(f"task {td.name} is none of this program's control tasks")
        self._processors.order(td.processor, order, td.bit, *arguments)

    # ------------------------------------------------------------------------------------------------ start and release

    def start(self, mask: int) -> None:
        """Activate tasks together; see `rci_start`."""
        chosen = self._chosen(mask, "start")
        for td in chosen:
            if td.bit not in self._functions:
                raise ConfigError(f"task {td.name} has no functions: call rci_control() first")
            if td.state in _RUNNING:
                raise ConfigError(f"task {td.name} is active already")
            td.error = None
            self._told.discard(td.bit)
        self._seal()
        try:
            self._each(chosen, "attach")
            self._wait_for(lambda: all(_has_come_up(td) for td in chosen))
            self._raise_error(chosen)
        except BaseException:
            self._let_go(chosen, power_off=False)
            raise
        self._each(chosen, "activate", self._processors.ticks + self._processors.start_lead)
        self._wait_for(lambda: all(td.state is not TaskState.READY for td in chosen))

    def release(self, mask: int, power_off: bool) -> None:
        """Let tasks rest; see `rci_release`."""
        chosen = self._chosen(mask, "release")
        with letting_go(lambda: self._power_off_left(chosen) if power_off else None):
            self._let_go(chosen, power_off)

    def _let_go(self, chosen: list[TaskDescriptor], power_off: bool) -> None:
        self._rest([td for td in chosen if td.state in _RUNNING], "release", power_off)

    def _power_off_left(self, chosen: list[TaskDescriptor]) -> None:
        """Switch off the power of arms that tasks have left holding, which had ended or were released before."""
        left = [td for td in chosen if td.robot is not None and td.starts and td.state not in _RUNNING]
        self._rest(left, "power_off")

    def _chosen(self, mask: int, what: str) -> list[TaskDescriptor]:
        chosen = [td for td in self.table.of(mask, what) if td is not self.parent]
        if not chosen:
            raise ConfigError(f"{what}: mask {mask!r} names no control task")
        return chosen

    def _each(self, chosen: list[TaskDescriptor], order: str, *arguments: object) -> None:
        """Give an order for several tasks, one to each processor."""
        for processor, bits in _by_processor(chosen):
            self._processors.order(processor, order, bits, *arguments)

    def _rest(self, chosen: list[TaskDescriptor], order: str, *arguments: object) -> None:
        """Order tasks to rest, on all processors before one is waited for; return when those of all that obey do.

        Raises the first error then.
        """
        answers = [(bits, self._begin(processor, order, bits, *arguments)) for processor, bits in _by_processor(chosen)]
        errors: list[BaseException] = []
        obeyed = 0
        for bits, answer in answers:
            try:
                answer()
                obeyed |= bits
            except Exception as error:
                errors.append(error)
        self._wait_for(lambda: not any(td.state in _RUNNING for td in chosen if td.bit & obeyed))
        raise_first(errors, ours_too=True)

    def _begin(self, processor: str, order: str, *arguments: object) -> Callable[[], object]:
        """See `Processors.begin`; what that raises, the wait raises."""
        try:
            return self._processors.begin(processor, order, *arguments)
        except Exception as error:
            return partial(raise_first, [error], ours_too=True)

    # --------------------------------------------------------------------------------------------------------- waiting

    @property
    def shared(self) -> SharedProgram:
        """The program as its tasks know it."""
        return SharedProgram(self.table, self.parent, lambda: self._processors.ticks, os.getpid())

    def wait(self, predicate: Callable[[], object]) -> None:
        """Return when `predicate` is true; see `rci_wait`."""
        self._raise_error(self._tasks)
        self._processors.wait(predicate, lambda: self._raise_error(self._tasks))

    def _wait_for(self, predicate: Callable[[], object]) -> None:
        self._processors.wait(predicate, lambda: None)

    def _raise_error(self, tasks: list[TaskDescriptor]) -> None:
        """Raise what ended a task, once."""
        for td in tasks:
            if td.error is not None and td.bit not in self._told:
                self._told.add(td.bit)
                raise td.error

    # ------------------------------------------------------------------------------------------------------------- end

    def close(self) -> None:
        """Release all tasks and end; see `rci_close`."""
        atexit.unregister(self._at_exit)
        _open.remove(self)
        try:
            self._let_go(self._tasks, power_off=False)
        finally:
            self._processors.close()
        self._raise_error(self._tasks)

    def begin_stop(self) -> None:
        """Let all tasks begin to rest; waits for nothing."""
        held = [td for td in self._tasks if td.state in _RUNNING]
        for processor, bits in _by_processor(held):
            self._begin(processor, "release", bits, False)  # one that is lost keeps no other one from its stop

    def _at_exit(self) -> None:
        try:
            with letting_go(self.close):
                if not interpreter_ends_well():
                    stop_all()
        except Exception as error:
            _exit_status.append(1)
            kind = "" if isinstance(error, QRobotError) else f"{type(error).__name__}: "
            with suppress(OSError):
                print(f"rci: {kind}{error}", file=sys.stderr)


_open: Final[list[RciProgram]] = []


@at_bad_end
def _stop_all() -> None:
    stop_each([program.begin_stop for program in _open])


_exit_status: Final[list[int]] = []  # of a program that hears of its tasks' bad end when it is over itself


@atexit.register  # early, therefore called late
def _leave_with_status() -> None:
    """End the process with a status that tells of failed tasks, which Python's own way out has no means for."""
    if _exit_status:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        os._exit(_exit_status[0])


def _by_processor(tasks: list[TaskDescriptor]) -> list[tuple[str, int]]:
    """Processors of tasks, each with the bits of its own."""
    names = dict.fromkeys(td.processor for td in tasks)
    return [(name, sum(td.bit for td in tasks if td.processor == name)) for name in names]


def _has_come_up(td: TaskDescriptor) -> bool:
    """True when it is ready, or has told why it is not: a processor of its own tells that a little later."""
    coming = td.state in (TaskState.ATTACHING, TaskState.RELEASING)  # one that failed is being let go
    return not coming and (td.state is not TaskState.ENDED or td.error is not None)


__all__ = ["ALL", "HOST", "Processors", "RciProgram"]
