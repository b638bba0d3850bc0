"""A program's hold of one arm: the calls of RCCL 1.0 as methods.

Units are those of the papers: degrees (mm on a sliding joint) and milliseconds. Nothing here waits except `control`,
`release`, `sample`, `waitfor` and `waitas`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import ConfigError, LinkError, MotionError, QRobotError, letting_go
from qrobot.motion import Equation, Exerted, PlannedPath, TransformKind, Trsf, motion_limits
from qrobot.motion.kept import WayBackLimit
from qrobot.rccl.arguments import require_function, sample_period_us
from qrobot.rccl.arm_session import ArmSession, ended_well
from qrobot.rccl.event import Event
from qrobot.rccl.hand_and_outputs import HandAndOutputs
from qrobot.rccl.parameters import MotionParameters, MoveOrder
from qrobot.rccl.position import Position, require_position, there
from qrobot.rccl.setpoints import Setpoints, judge
from qrobot.rccl.task import TrajectoryTask
from qrobot.rccl.trace import Trace, add_trace
from qrobot.rci import Chg, Link
from qrobot.rci.arguments import numbers, shown
from qrobot.units import DEG_PER_RAD, M_PER_MM, MM_PER_M, NS_PER_MS, RAD_PER_DEG, S_PER_MS
from qrobot.wire import RobotState

YES: Final = 1
NO: Final = 0


class Channel(HandAndOutputs, MotionParameters):
    """One arm under control of this program.

    Attributes:
        robot: the arm.
        completed: event, true while the arm has nothing to do.
        there: the position that is always the arm's own; a move to it is an absolute stop.
    """

    def __init__(
        self,
        robot: Robot,
        link: Link,
        task: TrajectoryTask,
        traces: list[Trace] | None = None,
        session: ArmSession | None = None,
        calls_functions: bool = True,
    ) -> None:
        super().__init__()
        self.robot = robot
        self.completed = task.completed
        self._task = task
        self._session = session or ArmSession(robot.name, link, task)
        self._calls_functions = calls_functions
        self._traces = traces
        self._alone = link.virtual_time  # nobody but this program lets time pass
        self._origin_ns = 0
        self.there = there()
        self._poses = {name: Position(name, q) for name, q in robot.poses.items()}
        self._radians = np.where(robot.prismatic, M_PER_MM, RAD_PER_DEG)

    # ---------------------------------------------------------------------------------------- control and release

    def start(self) -> Channel:
        """Run until the servo follows our setpoints. Raises what `control` raises."""
        self._session.start()
        self._origin_ns = self.how.t_ns
        return self

    def release(self, power_off: bool = False) -> None:
        """Bring the arm to rest, end the stream and say goodbye; a second call does nothing.

        The arm goes on holding its position, or loses power and closes its brakes when `power_off`.

        Raises:
            QRobotError: what ended control before, if the program has not heard of it yet.
        """
        self._session.release(power_off)

    @property
    def released(self) -> bool:
        """The arm was let go of."""
        return self._session.released

    def finish(self) -> None:
        """Wait until the motions that were asked for are done, as a program does that simply ends.

        Hayward and Paul's programs end with a `move` (1986, sections 3.3 and 3.4.2). Does nothing after `release`.

        Raises:
            MotionError: one of them could not be done.
            ServoFault, LinkError: control of the arm was lost.
        """
        self._session.finish()

    def __enter__(self) -> Channel:
        self._session.enter_block()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        well = ended_well(error)
        with letting_go(lambda: self._let_go(error)), self._session.leaving_block(well):
            if well:
                self.finish()

    def _let_go(self, error: BaseException | None) -> None:
        try:
            self.release()
        except QRobotError:
            if error is None:  # otherwise the first error is the one to tell
                raise

    # ------------------------------------------------------------------------------------------------- positions

    def jposition(self, name: str, degs: Sequence[float]) -> Position:
        """A position given by its joint angles, degrees (mm on a sliding joint).

        Raises:
            MotionError: too few numbers, too many, or one that is none.
        """
        if not isinstance(degs, Sequence | np.ndarray):
            raise MotionError(f"position {name}: {self.robot.n} numbers are needed, not {shown(degs)}")
        if len(degs) != self.robot.n:
            raise MotionError(f"position {name}: {self.robot.name} has {self.robot.n} joints, not {len(degs)}")
        return Position(name, np.array(numbers(f"position {name}", *degs)) * self._radians)

    def clear_share(self, start: Floats, goal: Floats) -> float:
        """Share of the joint motion from `start` to `goal`, degrees or mm, before it would come too near a fence.

        1 without fences. Shapes (n,).
        """
        if (fences := self._task.fences) is None:
            return 1.0
        return fences.for_one_thread().clear_share(start * self._radians, goal * self._radians)

    def pose(self, name: str) -> Position:
        """The pose of that name in the robot's file, always the same descriptor. Raises ConfigError: there is none."""
        if name not in self._poses:
            raise ConfigError(f"{self.robot.name} has no pose {name!r}; it has {', '.join(self._poses)}")
        return self._poses[name]

    @property
    def how(self) -> RobotState:
        """The robot as it was at the newest sample, SI units."""
        if self._task.how is None:
            raise LinkError("nothing was heard of the robot yet")
        return self._task.how

    @property
    def chg(self) -> Chg:
        """The next command: hand and outputs are the program's, the joints those of its motions.

        A function given to `each_sample` may change the joints' modes and setpoints too.
        """
        return self._task.chg

    def each_sample(self, function: Callable[[], object] | None) -> None:
        """Call `function` at every sample, when the command is made up and before it goes out; None ends that.

        It may read `how` and change `chg`, and must be quick. What it raises stops the arm and reaches the program, as
        does what it asks for and no task of RCI may: a joint out of its range, too fast, or a torque beyond the limit.
        The motions know nothing of joints it moves elsewhere: it has to bring them back before it ends, or the way back
        is such a thing.
        """
        if function is not None:
            require_function("each_sample", function)
            self._check_calls("each_sample")
        with self._session.task():
            self._task.each_sample = function

    @property
    def overruns(self) -> dict[str, float]:
        """Functional transforms whose function has taken longer than a sample period, with the longest time, ms."""
        return self._task.timing.overruns

    @property
    def joints(self) -> Floats:
        """Measured joint positions, degrees (mm on a sliding joint). Shape (n,)."""
        return np.asarray(self.how.q) / self._radians

    @property
    def measured_t6(self) -> Floats:
        """T6 of the measured joint positions, m. Shape (4, 4)."""
        return self._task.motions.arm.forward(np.array(self.how.q))

    @property
    def time(self) -> float:
        """The robot's time since `control`, ms."""
        return (self.how.t_ns - self._origin_ns) / NS_PER_MS

    # ---------------------------------------------------------------------------------------------------- motions

    def sample(self, ms: float) -> None:
        """The sample period of the following motions, 1 to 100 ms.

        Waits until those before are completed, and while the bridge is asked for another period: the arm then stands
        still under power, also one that followed a frame or gave way.

        Raises:
            MotionError: no such period.
            LinkError, ServoFault: as in `control`; the arm is then no longer under control.
        """
        period_us = sample_period_us("sample", ms)
        if period_us != round(self._task.period_s * 1e6):
            self.waitfor(self.completed)
            self._session.change_period(period_us, add_trace(self._traces, self.robot, period_us))

    def update(self, trsf: Trsf, position: Position) -> None:
        """Give `trsf`, when the next motion ends, the value that makes the equation of `position` true.

        The measured T6 counts, as it is at that instant: at rest, half way round a via point, or where the motion is
        interrupted, whether the arm then goes on or is brought to rest. A motion that is dropped before it has begun
        updates nothing. Several transforms may be updated by one motion, in the order of the calls.

        Raises:
            MotionError: the position has no equation, or that does not name the transform once; or the next motion is
                to update that transform already.
        """
        self.check_update(trsf, position)
        self._update_next(trsf, position)

    def check_update(self, trsf: Trsf, position: Position) -> None:
        """Raise what `update` would, and do nothing else."""
        equation = require_position("update", position).equation
        with self._session.task():  # functions of transforms are called, which samples call too
            equation.solve(trsf, np.eye(4), self._task.tick)

    @property
    def exerted(self) -> Exerted:
        """Torques that the joints exert on the world at the newest sample, with their uncertainty; N m (N).

        The commanded torque less gravity, inertia and friction. Raises LinkError before the first sample, MotionError
        for an arm whose torques nobody knows, or that carries a load which this program has not told.
        """
        self._require_forces("exerted")
        if self._task.force.exerted is None:
            raise LinkError("nothing was heard of the robot yet")
        return self._task.force.exerted

    def move(self, position: Position) -> None:
        """Queue a motion to `position` and return at once.

        Its equation becomes true, and remains true until another motion begins: frames that move are followed. What
        was said for it alone counts again when it is refused and the next motion goes to the same position.

        Raises:
            JointLimit, Unreachable, Singular: the position, or a straight way there, is not for this arm.
            MotionError: the arm cannot do it in that time, or too many motions wait (see `nbrequest`).
        """
        order = self._order(require_position("move", position))
        self._check_functions(order)
        with self._session.task():
            self._task.push(order)
        self._taken()

    def _check_functions(self, order: MoveOrder) -> None:
        """Raise MotionError for a motion with functions, where nobody would call them."""
        if order.request.monitor is not None:
            self._check_calls(f"move to {order.position.name}, with `evalfn`")
        if isinstance(order.position.target, Equation):
            for term in order.position.target.terms:
                if term.kind is TransformKind.FUNCTION:
                    self._check_calls(f"move to {order.position.name}, with the function of transform {term.name}")

    def _check_calls(self, what: str) -> None:
        if not self._calls_functions:
            raise MotionError(
                f"{what}: the generator has a process of its own, which calls no function of the program at a sample; "
                'let transforms be variable and change their values, or take control with processor="host"'
            )

    def play(self, setpoints: Setpoints, label: str = "setpoints") -> None:
        """Send setpoints as they are, at full speed one each sample, and return; `completed` when the last one is out.

        They must begin where the arm stands. At an override below 100 %, the program's or the operator's, they pass
        slower, and in a pause not at all, as other motions do. `label` says where they are from, for messages.

        Raises:
            JointLimit, MotionError: the arm cannot do that, does not stand there, moves, or has another sample period.
        """
        task, limits = self._task, motion_limits(self.robot).slowed(self.how.speed_limit)
        fences = None if task.fences is None else task.fences.for_one_thread()
        judge(setpoints, self.robot.name, task.period_s, limits, fences, label)  # long ones take longer than a sample
        with self._session.task():
            task.play(setpoints, label)

    def plan(self) -> PlannedPath:
        """The path from now to rest of the motions asked for so far, before it runs; SI units, as in `how`.

        `plan().at(t)` has position, velocity and acceleration of the joints `t` seconds from now. Off line and in
        lock-step nothing moves between `move` and the next wait.

        Raises:
            MotionError: a goal moves, or the arm complies: nobody can know the path.
        """
        with self._session.task():
            generator = self._task.generator.copy()
        return generator.run_to_rest()

    def stop(self, ms: float = 0.0) -> None:
        """Forget all motions and come to rest, in at least `ms` or at its goal; `completed` when the arm stands.

        The arm stays on its path. It stops as soon as its joints can, whatever `ms` is, where they cannot follow a
        straight line so, and on the way to a frame that moves; the rest is absolute also while one is followed. A stop
        under way that takes longer than this one becomes this one.
        """
        (ms,) = numbers("stop", ms)
        if ms < 0.0:
            raise MotionError(f"stop({ms:g}): a stop takes no negative time")
        with self._session.task():
            self._task.stop(ms * S_PER_MS)

    def override(self, percent: float) -> None:
        """Let motions go at `percent` of their programmed speed, 0 to 100, also the one under way.

        The path stays the same, and so does every place on it; programmed times, those of a dwell too, become longer.
        The operator's override (`qrobot ctl override`) counts besides. Motions with frames that move, or that comply,
        know no other speed than their own.

        Raises:
            MotionError: that is no percentage.
        """
        (percent,) = numbers("override", percent)
        if not 0.0 <= percent <= 100.0:
            raise MotionError(f"override({percent:g}): 0 to 100 per cent are possible")
        self._task.override = percent / 100.0

    def pause(self) -> None:
        """Let motions come to a standstill on their path, and stay there until `resume`; nothing is forgotten.

        It is no stop: `completed` does not become true, and what follows a frame that moves goes on. An arm that is led
        back to its path (`keep_path`) stands still on its way; `kept` tells so.
        """
        self._task.paused = True

    def resume(self) -> None:
        """Let motions go on that `pause` holds; those that the operator holds wait for `qrobot ctl resume`.

        An arm that has left its path (`keep_path`) is led back to it.
        """
        self._task.resume()

    def keep_path(self, keep: bool = True, way_back_mm: float | None = None, way_back_deg: float | None = None) -> None:
        """Let motions outlive a stop of the servo, and a bridge that comes back: they wait until somebody confirms.

        Instead of ServoFault or LinkLost the program sees them stand still (`kept` tells why). After `resume`, or
        `qrobot ctl resume`, a fault is cleared, the arm gets power and goes back to its path at a tenth of its speed,
        as joints go, and the motions go on where they were left. Not kept are motions to goals that move or give way,
        those being stopped, and setpoints that are played; and `stop` and `release` give the path up. An arm that stays
        with a goal which moves goes back to it when that stands. Other arms of the program wait on their paths.

        The arm is led back where its flange, straight for the joints, has no more than `way_back_mm` to go (300 when
        left out) and no joint turns by more than `way_back_deg` (45). Else it waits on, and `kept` tells how far it is;
        another `keep_path` may allow more meanwhile.

        Raises:
            MotionError: no such distance or angle.
        """
        usual = WayBackLimit()
        told = (usual.way_m * MM_PER_M if way_back_mm is None else way_back_mm,
                usual.turn * DEG_PER_RAD if way_back_deg is None else way_back_deg)  # fmt: skip
        way_mm, turn_deg = numbers("keep_path", *told)
        if way_mm < 0.0 or turn_deg < 0.0:
            raise MotionError(f"keep_path({way_mm:g} mm, {turn_deg:g} deg): a way back is no shorter than 0")
        self._task.keeps_path, self._task.way_back = keep, WayBackLimit(way_mm * M_PER_MM, turn_deg * RAD_PER_DEG)

    @property
    def kept(self) -> str:
        """Reason for which the arm stands off its path, until somebody confirms that it may go back; else empty."""
        return "" if (reason := self._task.kept) is None else str(reason)

    @property
    def off_path(self) -> bool:
        """The arm is off its path: it waits (`kept`), is led back to it, or goes back from what it met (`retract`)."""
        return self._task.off_path

    @property
    def rate(self) -> float:
        """Speed of the motion as a share of the programmed one, now: 0 while it is paused, 1 as programmed."""
        with self._session.task():
            return self._task.rate

    def nextmove(self, code: int = YES) -> None:
        """End the present motion now with `code` in its position; go on to the next one, or stop if none waits.

        While the arm stands and motions wait, which begin at the next sample, the oldest of them is the present one.

        RCCL's global flag. Raises MotionError: `code` is not positive, so it could not be told from our own.
        """
        if not isinstance(code, int) or code <= 0:
            raise MotionError(f"nextmove({shown(code)}): the code must be a positive whole number")
        with self._session.task():
            self._task.generator.skip(code)

    @property
    def nbrequest(self) -> int:
        """Number of motions that wait in the queue."""
        with self._session.task():
            return self._task.generator.waiting

    @property
    def unserved(self) -> int:
        """Number of motions that wait or are under way, but for one that is being stopped."""
        with self._session.task():
            generator = self._task.generator
            return generator.waiting + int(generator.serving is not None and not generator.stopping)

    # ---------------------------------------------------------------------------------------------------- waiting

    def waitfor(self, event: Event) -> None:
        """Wait until `event` is signalled, and use up one signal.

        Raises:
            ServoFault, LinkError: control of the arm was lost, here or earlier.
            MotionError: in lock-step, where nobody else could signal: no motion is left that would.
        """
        if not isinstance(event, Event):
            raise MotionError(f"waitfor: an event is needed, as the `end` of a position, not {event!r}")
        self._session.wait(lambda: self._happened(event))

    def waitas(self, predicate: Callable[[], object]) -> None:
        """Wait until `predicate`, called at every sample, is true. Raises what `waitfor` raises."""
        require_function("waitas", predicate)
        self._session.wait(lambda: bool(predicate()), ours=False)

    def check(self) -> None:
        """Raise what has ended control of the arm, if anything has."""
        with self._session.task():
            pass

    def expect(self, event: str) -> None:
        """Raise MotionError in lock-step, where nobody else could, when no motion is left to signal that event."""
        self.check()  # what has ended control is the reason, if anything has
        if self._alone and not self._task.eventful:
            raise MotionError(f"waitfor({event}): no motion is left that could signal it")

    def _happened(self, event: Event) -> bool:
        if event.take():
            return True
        self.expect(event.name)
        return False
