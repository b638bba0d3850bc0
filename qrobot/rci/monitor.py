"""The monitor of one processor: it calls the tasks that are ready to run, one after the other (section 5.3.2).

Each runnable task gets one run a round, those of higher priority first, until none is runnable. The monitor owns no
clock: whoever does tells it how far time has come, and which robots and devices have something to say.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, TypeAlias

from qrobot.errors import ConfigError, LinkTimeout
from qrobot.rci.aside import Aside, Outcome, at_once
from qrobot.rci.common_clock import CommonClock
from qrobot.rci.descriptor import TaskDescriptor
from qrobot.rci.environment import OpenLink
from qrobot.rci.program_time import run_rounds
from qrobot.rci.readiness import await_readable
from qrobot.rci.schedule import ClockEntry, TaskScheduler
from qrobot.rci.task_runner import ControlFunctions, Greeting, TaskRunner

LeftRobots: TypeAlias = list[tuple[TaskRunner, Outcome[Greeting | None]]]


class Monitor:
    """The tasks of one processor.

    Args:
        name: of the processor.
        clock: the common one.

    Attributes:
        aside: opens and closes the links of its robots; whoever runs the monitor in real time has it done elsewhere.
    """

    def __init__(self, name: str, clock: CommonClock) -> None:
        self.name = name
        self.aside: Aside = at_once
        self._clock = clock
        self._runners: dict[int, TaskRunner] = {}  # by bit
        self._triggers: dict[int, Callable[[TaskDescriptor], object]] = {}
        self._scheduler = TaskScheduler()  # the key of a trigger is the bit made negative
        self._looked_ns = 0  # for silent robots

    # ------------------------------------------------------------------------------------------- orders of the parent

    def add(self, td: TaskDescriptor, open_link: OpenLink | None) -> None:
        """Run a task of this descriptor."""
        self._runners[td.bit] = TaskRunner(td, self._clock, open_link, self.aside)
        ranked = sorted(self._runners.items(), key=lambda item: -item[1].td.priority)  # creation decides between equals
        self._runners = dict(ranked)

    def obey(self, order: str, *arguments: Any) -> None:
        """Do one of the following by name."""
        getattr(self, order)(*arguments)

    def set_functions(self, bit: int, functions: ControlFunctions) -> None:
        """Give a task its functions; they change between two runs."""
        self._runners[bit].functions = functions

    def set_clock(self, bit: int, interval: int, offset: int) -> None:
        """Wake a task by the clock. Raises ConfigError for one that holds a robot."""
        runner = self._runners[bit]
        if runner.attached:
            raise ConfigError(f"task {runner.td.name} holds its robot, whose sample period is fixed: release it first")
        runner.entry, runner.wakeup = ClockEntry(interval, offset), None
        if runner.td.robot is None:
            self._scheduler.set(bit, interval, offset)

    def set_wakeup(self, bit: int, wakeup: Callable[[], object]) -> None:
        """Wake a task by a function."""
        self._scheduler.remove(bit)
        self._runners[bit].entry, self._runners[bit].wakeup = None, wakeup

    def set_device(self, bit: int, device: int) -> None:
        """Wake a task, or ask its wake-up function, when a descriptor is readable."""
        self._runners[bit].device = device

    def set_trigger(self, bit: int, interval: int, offset: int, trigger: Callable[[TaskDescriptor], object]) -> None:
        """Call a function for a task by the clock."""
        self._triggers[bit] = trigger
        self._scheduler.set(-bit, interval, offset)

    def attach(self, bits: int) -> None:
        """Start tasks up, and take their robots."""
        for runner in self._of(bits):
            runner.attach()

    def activate(self, bits: int, after: int) -> None:
        """Run tasks from the first wake-up behind tick `after` on."""
        for runner in self._of(bits):
            runner.activate(after)
            for key in (runner.td.bit, -runner.td.bit):
                self._scheduler.activate(key, after)

    def release(self, bits: int, power_off: bool) -> None:
        """Let tasks rest, and let go of their robots."""
        for runner in self._of(bits):
            for key in (runner.td.bit, -runner.td.bit):
                self._scheduler.deactivate(key)
            runner.release(power_off)

    def power_off(self, bits: int) -> None:
        """Switch the power of robots off that were let go with it. Raises the first reason for one that cannot be."""
        self.take_left(self.greet_left(bits))

    def greet_left(self, bits: int) -> LeftRobots:
        """Greet the robots that were let go with power; may be called from any thread."""
        return [(runner, Outcome(runner.greet_left)) for runner in self._of(bits)]

    def take_left(self, left: LeftRobots) -> None:
        """Switch off the power of those that were greeted. Raises the first reason for one that cannot be."""
        errors: list[Exception] = []
        for runner, outcome in left:
            try:
                if (greeting := outcome.get()) is not None:
                    runner.power_off(greeting)
            except Exception as error:  # the others shall lose their power all the same
                errors.append(error)
        if errors:
            raise errors[0]

    def _of(self, bits: int) -> list[TaskRunner]:
        return [runner for bit, runner in self._runners.items() if bit & bits]

    # -------------------------------------------------------------------------------------------------- as time passes

    @property
    def runners(self) -> list[TaskRunner]:
        """All tasks, in the order in which they run."""
        return list(self._runners.values())

    @property
    def attached(self) -> list[TaskRunner]:
        """Tasks that hold a robot."""
        return [runner for runner in self._runners.values() if runner.attached]

    @property
    def next_tick(self) -> int | None:
        """The next tick at which something is due, None when nothing is."""
        return self._scheduler.next_tick

    @property
    def waits_for_functions(self) -> bool:
        """An active task is woken by a function alone, which wants to be called at every tick."""
        return any(r.wakeup is not None and r.device is None and r.td.active for r in self._runners.values())

    @property
    def sources(self) -> dict[int, TaskRunner]:
        """Descriptors that become readable when a task is to be woken: of robots and of devices."""
        robots: dict[int, TaskRunner] = {}
        for runner in self.attached:
            with runner.guarded():
                if runner.port is not None:
                    robots[runner.port.fileno()] = runner
        return robots | self.devices

    @property
    def devices(self) -> dict[int, TaskRunner]:
        """Devices of active tasks by descriptor."""
        return {r.device: r for r in self._runners.values() if r.device is not None and r.td.active}

    def pass_ticks(self, tick: int) -> None:
        """The clock has come to `tick`: wake what is due, call triggers."""
        for key, times in self._scheduler.due(tick):
            runner = self._runners[abs(key)]
            if not runner.td.active:
                continue  # it has ended
            if key < 0:
                self._call_trigger(runner)
            else:
                runner.wake(times)

    def _call_trigger(self, runner: TaskRunner) -> None:
        with runner.guarded():
            runner.watched(lambda: self._triggers[runner.td.bit](runner.td))

    def ask_functions(self) -> None:
        """Wake the tasks without a device whose wake-up functions say so."""
        for runner in self._runners.values():
            if runner.wakeup is not None and runner.device is None:
                self.wake_by_function(runner)

    def wake_by_function(self, runner: TaskRunner) -> None:
        """Wake a task that has answered every wake-up, unless its function says that there is nothing to do."""
        if runner.td.active and not runner.td.run_count:
            with runner.guarded():
                if runner.wakeup is None or runner.watched(runner.wakeup):
                    runner.wake()

    def hear(self, descriptors: Iterable[int]) -> None:
        """Wake the tasks whose robots or devices have something to say."""
        sources, robots = self.sources, set(self.heard)
        for descriptor in descriptors:
            runner = sources.get(descriptor)
            if runner is None:
                continue
            if runner.device == descriptor:
                self.wake_by_function(runner)
            else:
                robots.add(runner)
        for runner in robots:
            runner.wake()

    @property
    def heard(self) -> list[TaskRunner]:
        """Tasks whose robots have said something that no descriptor tells of any more."""
        return [runner for runner in self.attached if runner.port is not None and runner.port.has_state]

    def hear_devices(self) -> None:
        """Wake the tasks whose devices can be read now, on virtual time."""
        if devices := self.devices:
            ready = await_readable(devices, 0.0)
            self.end_deaf(ready.closed)
            for descriptor in devices:
                if descriptor in ready.readable:
                    self.wake_by_function(devices[descriptor])

    def end_deaf(self, closed: Iterable[int]) -> None:
        """End the tasks whose devices were closed under them."""
        devices = self.devices
        for descriptor in closed:
            if (runner := devices.get(descriptor)) is not None:
                runner.end(ConfigError(f"task {runner.td.name}: its device was closed: release the task before"))

    def end_silent(self, now_ns: int, patience_ns: int, look_ns: int) -> None:
        """End the tasks whose robots have not been heard for so long, while somebody listened.

        `look_ns` after the last call this one is due at the latest. What it comes later by does not count: the process
        was kept from running, or this thread by its interpreter, and what a robot said waits to be read.
        """
        held_up_ns = max(0, now_ns - self._looked_ns - look_ns)
        self._looked_ns = now_ns
        for runner in self.attached:
            runner.heard_ns = max(runner.heard_ns, min(runner.heard_ns + held_up_ns, now_ns))
            if now_ns - runner.heard_ns > patience_ns:
                runner.end(LinkTimeout(f"task {runner.td.name}: the bridge of its robot has fallen silent"))

    def wake_sampled(self, now_ns: int) -> None:
        """Wake the tasks whose robots have a sample at this instant of virtual time."""
        for runner in self.attached:
            if runner.next_ns is not None and runner.next_ns <= now_ns:
                runner.wake()
                runner.plan_sample()

    def run_ready(self) -> None:
        """Run tasks in rounds until none is runnable."""
        run_rounds(self.runners)
