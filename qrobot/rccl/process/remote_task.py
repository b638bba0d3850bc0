"""The task in a generator's process as its program sees it: the newest report, and orders."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

from qrobot.config import Robot
from qrobot.errors import LinkError
from qrobot.fences.fence_set import FenceSet
from qrobot.model.arm import Arm
from qrobot.motion import EventKind, Exerted, MotionEvent, MoveRequest, PlannedPath
from qrobot.motion.kept import WayBackLimit
from qrobot.motion.trajectory.speed_override import FULL_SPEED
from qrobot.rccl.callback_timing import CallbackTiming
from qrobot.rccl.event import Level
from qrobot.rccl.open_motions import OpenMotions
from qrobot.rccl.parameters import MoveOrder
from qrobot.rccl.process.generator_process import GeneratorProcess
from qrobot.rccl.process.reports import GeneratorReport, Seen
from qrobot.rccl.setpoints import Setpoints
from qrobot.rccl.trace import Trace
from qrobot.rci import RobotData, TaskDescriptor
from qrobot.rci.descriptor import NO_BIT, local_area
from qrobot.rci.sampled_task import end_badly
from qrobot.wire import Payload, RobotState

ONCE: Final = ("stop", "key_held")  # fields of `chg` that go out once and are lowered again
CHANGED: Final = ("hand", "outputs", "signals", "hold_to_run", *ONCE)  # those that are the program's


class RemoteGenerator:
    """The generator as it was reported last; see `Generator`."""

    def __init__(self, process: GeneratorProcess, seen: Callable[[], Seen]) -> None:
        self._process, self._seen = process, seen

    @property
    def waiting(self) -> int:
        """See `Generator.waiting`."""
        return self._seen().waiting

    @property
    def serving(self) -> bool | None:
        """True when a segment is under way, else None."""
        return True if self._seen().serving else None

    @property
    def stopping(self) -> bool:
        """See `Generator.stopping`."""
        return self._seen().stopping

    def skip(self, code: int) -> None:
        """See `Generator.skip`."""
        self._process.ask("skip", code)

    def copy(self) -> RemoteGenerator:
        """Itself: `run_to_rest` is asked of a copy there."""
        return self

    def run_to_rest(self) -> PlannedPath:
        """The path from now to rest. Raises what `Generator.copy` raises."""
        path: PlannedPath = self._process.ask("plan")
        return path


class RemoteForce:
    """Forces as they were reported last; see `ForceControl`."""

    def __init__(self, seen: Callable[[], Seen]) -> None:
        self._seen = seen

    @property
    def exerted(self) -> Exerted | None:
        """See `ForceControl.exerted`."""
        return self._seen().exerted


class _Setting:
    """An attribute that a program sets, and the other process has as well.

    Args:
        usual: its value at first.
    """

    def __init__(self, usual: object) -> None:
        self._usual = usual
        self._name = ""

    def __set_name__(self, _owner: type, name: str) -> None:
        self._name = name

    def __get__(self, task: RemoteTask, _owner: type) -> Any:
        return task._values.get(self._name, self._usual)

    def __set__(self, task: RemoteTask, value: object) -> None:
        task.process.ask("set", self._name, value)
        task._values[self._name] = value


class RemoteTask:
    """The trajectory task of one arm in another process, as `Channel` and `ArmSession` know it; see `TrajectoryTask`.

    Args:
        robot: the arm.
        period_s: sample period.
        process: of the task.
        processor: its name.
        fences: that the arm keeps off, None for none.
    """

    override = _Setting(FULL_SPEED)
    paused = _Setting(False)
    keeps_path = _Setting(False)
    way_back = _Setting(WayBackLimit())
    retract_m = _Setting(0.0)
    each_sample = None  # there is none: `Channel` refuses it

    def __init__(
        self, robot: Robot, period_s: float, process: GeneratorProcess, processor: str, fences: FenceSet | None = None
    ) -> None:
        self.robot, self.period_s = robot, period_s
        self.group = None
        self.fences = fences
        self.completed = Level("completed", 1)
        self.motions = OpenMotions(Arm(robot))
        self.timing = CallbackTiming(period_s * 1e3)
        self.td = TaskDescriptor(robot.name, NO_BIT, processor, local_area(), RobotData(robot, fences))
        self.chg = self.td.chg
        self.generator = RemoteGenerator(process, lambda: self.seen)
        self.force = RemoteForce(lambda: self.seen)
        self.process = process
        self._values: dict[str, Any] = {}
        self._seen: Seen | None = None
        self._told = self._program_fields()
        self._adopted = False
        self._asked: dict[int, MoveOrder] = {}  # motions of which nothing was heard yet
        process.heard, process.ended = self.hear, lambda error: end_badly(self.td, error)

    @property
    def seen(self) -> Seen:
        """The newest report. Raises LinkError before the first."""
        if self._seen is None:
            raise LinkError("the arm is not under control yet")
        return self._seen

    # ------------------------------------------------------------------------------------------------ what was reported

    def hear(self, report: GeneratorReport) -> None:
        """Take a report over: events of motions, and the newest state."""
        if report.seen is not None:
            self._look(report.seen)
        for kind, number, code, q, tick, why in report.happened:
            self.motions.notify([MotionEvent(kind, self._request(number), code, why)], q, tick)
            if kind is EventKind.ENDED:
                self.process.ends.forget(number)
        for number, scal in report.progress:
            if (request := self._request(number)) is not None:
                self.motions.show_progress(request, scal)
        self.tell_changes()

    def _request(self, number: int) -> MoveRequest | None:
        """The request of that number, whose motion is open from now on."""
        if (order := self._asked.pop(number, None)) is not None:
            self.motions.add(order)
        return self.process.ends.request(number)

    def _look(self, seen: Seen) -> None:
        self._seen = seen
        self.completed.count = seen.completed
        self.td.words[: len(seen.words)] = seen.words
        if seen.how is not None:
            self.td.how = seen.how
        if not self._adopted:  # hand and outputs are at first as the robot tells
            self.chg.hand, self.chg.outputs = seen.hand, seen.outputs
            self._told |= {"hand": seen.hand, "outputs": seen.outputs}
            self._adopted = seen.follows_setpoints

    def _program_fields(self) -> dict[str, Any]:
        return {name: getattr(self.chg, name) for name in CHANGED}

    def tell_changes(self) -> None:
        """Hand over what the program has changed in `chg`; what its thread changes meanwhile is for the next time."""
        now = self._program_fields()
        changed = {name: value for name, value in now.items() if value != self._told[name]}
        if changed:
            self.process.tell("change", changed)
        for name in ONCE:
            if now[name]:
                setattr(self.chg, name, False)
        self._told = now | dict.fromkeys(ONCE, False)

    @property
    def how(self) -> RobotState | None:
        """See `TrajectoryTask.how`."""
        return self.td.heard

    @property
    def tick(self) -> int:
        """See `TrajectoryTask.tick`."""
        return self.seen.tick

    @property
    def follows_setpoints(self) -> bool:
        """See `TrajectoryTask.follows_setpoints`."""
        return self._seen is not None and self._seen.follows_setpoints

    @property
    def eventful(self) -> bool:
        """See `TrajectoryTask.eventful`."""
        return self._seen is not None and self._seen.eventful

    @property
    def rate(self) -> float:
        """See `TrajectoryTask.rate`."""
        return self.seen.rate

    @property
    def left(self) -> bool:
        """See `TrajectoryTask.left`."""
        return self._seen is not None and self._seen.left

    @property
    def kept(self) -> str | None:
        """See `TrajectoryTask.kept`, in words."""
        return self.seen.kept or None

    @property
    def off_path(self) -> bool:
        """See `TrajectoryTask.off_path`."""
        return self.seen.off_path

    # ----------------------------------------------------------------------------------------------------------- orders

    def push(self, order: MoveOrder) -> None:
        """See `TrajectoryTask.push`."""
        number = self.process.ends.number(order.request)
        self._asked[number] = replace(order, updates=())  # which are done there, at their instant
        try:
            self.process.ask("push", number, order)
        except BaseException:
            self.process.ends.forget(number)
            self._asked.pop(number, None)
            raise
        self._request(number)

    def play(self, setpoints: Setpoints, label: str) -> None:
        """See `TrajectoryTask.play`."""
        self.process.ask("play", setpoints, label)

    def stop(self, seconds: float = 0.0) -> None:
        """See `TrajectoryTask.stop`."""
        self.process.ask("stop", seconds)

    def begin_stop(self) -> None:
        """See `TrajectoryTask.begin_stop`."""
        self.process.tell("stop", 0.0)

    def resume(self) -> None:
        """See `TrajectoryTask.resume`."""
        self._values["paused"] = False
        self.process.ask("resume")

    def leave(self, power_off: bool) -> None:
        """See `TrajectoryTask.leave`."""
        self.process.ask("leave", power_off)

    def carry(self, load: Payload) -> None:
        """See `TrajectoryTask.carry`."""
        self.process.ask("carry", load)

    def begin(self, period_s: float, trace: Trace | None = None) -> None:  # noqa: ARG002
        """See `TrajectoryTask.begin`; no trace reaches the other process."""
        self.period_s = period_s
        self.timing = CallbackTiming(period_s * 1e3)
        self.process.ask("begin", period_s)
