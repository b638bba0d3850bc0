"""Object frames: a frame with a trajectory generator of its own, which arms that use it in their equations follow.

One path is computed for the object, and the arms keep constant offsets to it (Lloyd et al. 1987, section 3.1). The
frame is evaluated when the first arm comes to a sample, before that arm's own equations; every arm finds the same pose
at the same sample. Time passes for it as long as some arm of the program is under control.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import LinkError, MotionError
from qrobot.model.branch import Branch
from qrobot.motion import FULL_SPEED, Equation, EventKind, Generator, Goal, MotionEvent, MotionMode, Termination
from qrobot.motion.world.frame_kinematics import FrameKinematics, frame_limits
from qrobot.multi_rccl.manip import Manip, absolute_stop, follows
from qrobot.multi_rccl.moving_transform import MovingTransform
from qrobot.multi_rccl.positions import goal_for
from qrobot.rccl.arguments import sample_period_us
from qrobot.rccl.event import Level
from qrobot.rccl.open_motions import OpenMotions
from qrobot.rccl.parameters import MotionParameters, MoveOrder
from qrobot.rccl.position import Position
from qrobot.rccl.task_group import TaskGroup
from qrobot.rccl.trace import reason_of
from qrobot.units import S_PER_MS

PERIOD_S: Final = 0.028  # where no arm has another


class FrameParameters(MotionParameters):
    """Motion parameters of a frame, which has no joints and exerts no forces."""

    def __init__(self) -> None:
        super().__init__()
        self._mode = MotionMode.CARTESIAN

    def setmode(self, mode: str, turn: str = "axis") -> None:
        """See `MotionParameters.setmode`. Raises MotionError: joint mode means nothing here."""
        if mode in ("joint", "j"):
            raise MotionError("setmode: an object frame has no joints; it moves in Cartesian mode only")
        super().setmode(mode, turn)

    def setjvel(self, speed: float | None = None, *, share: float | None = None) -> None:  # noqa: ARG002
        """Raise MotionError: there are no joints."""
        raise MotionError("setjvel: an object frame has no joints; setvel says how fast it moves")

    def setconf(self, letters: str) -> None:  # noqa: ARG002 (see MotionParameters)
        """Raise MotionError: there are no joints."""
        raise MotionError("setconf: an object frame has no joints, and so no configurations")

    def lock(self, dirs: str) -> None:  # noqa: ARG002 (see MotionParameters)
        """Raise MotionError: arms comply, not frames."""
        raise MotionError("lock: an object frame complies along nothing")

    def comply(self, dirs: str, *values: float) -> None:  # noqa: ARG002 (see MotionParameters)
        """Raise MotionError: arms comply, not frames."""
        raise MotionError("comply: an object frame exerts no forces; let an arm that holds the object comply")

    def limit(self, spec: str, *values: float) -> None:  # noqa: ARG002 (see MotionParameters)
        """Raise MotionError: arms feel forces, not frames."""
        raise MotionError("limit: an object frame feels no forces; limit the motion of an arm")

    @contextmanager
    def order(self, position: Position) -> Iterator[MoveOrder]:
        """The motion that a call of `move` asks for, to be queued inside `with`."""
        yield self._order(position)
        self._taken()


class ObjectFrame(Manip):
    """See `Manip`.

    Args:
        name: for traces and messages.
        group: the program's arms.
    """

    def __init__(self, name: str, group: TaskGroup) -> None:
        self.name, self.completed = name, Level("completed", 1)
        self.trans = MovingTransform(name, name, self._look)
        self.error: Exception | None = None
        self._group, self._kinematics = group, FrameKinematics()
        group.frames.append(self.trans)
        self._parameters, self._motions = FrameParameters(), OpenMotions(self._kinematics)
        self._generator: Generator | None = None
        self._put: Goal | None = None  # where it is to be from the next sample on
        self._last: Position | None = None
        self._tracks, self._track_next, self._evaluating = False, False, False
        self._tick = 0  # the newest sample that was evaluated

    # ------------------------------------------------------------------------------------------- from the program

    def control(self, clear_fault: bool, period_ms: float | None) -> None:  # noqa: ARG002 (nothing can have failed)
        """Turn its generator on: the frame is at the origin. Raises MotionError: the arms have another period."""
        with self._group.sampled:
            if self._generator is not None:
                raise MotionError(f"{self.name} is under control already")
            period_s = self._group.period_s or PERIOD_S
            self._group.agree_on(period_s if period_ms is None else sample_period_us("rccl_control", period_ms) * 1e-6)
            self._tick = self._group.tick
            self._generator = self._generator_at(self.trans.value)
            self.trans.record(self._tick, self.trans.value)
            self._group.members.append(self)

    def release(self) -> None:
        """Turn its generator off: it is where it is, and moves no more."""
        with self._group.sampled:
            if self._generator is not None:
                self._generator = None
                self._group.members.remove(self)

    @property
    def parameters(self) -> MotionParameters:
        """See `Manip.parameters`."""
        return self._parameters

    @property
    def eventful(self) -> bool:
        """See `Manip.eventful`."""
        return self.busy or (self._generator is not None and self._generator.has_events)

    @property
    def waiting(self) -> int:
        """See `Manip.waiting`."""
        return 0 if self._generator is None else self._generator.waiting

    def skip(self, code: int) -> None:
        """See `Manip.skip`."""
        with self._group.sampled:
            self.generator.skip(code)

    def check(self) -> None:
        """Raise once what its functions have raised, or that it could not follow what it maintained."""
        if self.error is not None:
            error, self.error = self.error, None
            raise error

    def move(self, position: Position) -> None:
        """See `Manip.move`. Raises MotionError for a position that is given by joints, too."""
        self._check("move", position)
        with self._group.sampled, self._parameters.order(position) as order:
            self._push(order)
            self._last, self._tracks, self._track_next = position, self._track_next, False

    def stand(self, ms: float) -> None:
        """See `Manip.stand`."""
        with self._group.sampled:
            self._push(absolute_stop(ms))

    def cancel(self, ms: float) -> None:
        """See `Manip.cancel`."""
        with self._group.sampled:
            self.generator.stop(ms * S_PER_MS)

    def maintain(self, position: Position) -> None:
        """See `Manip.maintain`. Raises MotionError: motions of its own are still to be done."""
        self._check("maintain", position)
        with self._group.sampled:
            if self.eventful:
                raise MotionError(f"maintain: {self.name} still moves; wait for `completed` first")
            self._put, self._tracks, self._last = position.equation.goal(), True, position

    def track(self) -> None:
        """See `Manip.track`."""
        self._track_next = True

    @property
    def generator(self) -> Generator:
        """Its generator. Raises LinkError before `control`."""
        if self._generator is None:
            raise LinkError(f"{self.name} is not under control; call rccl_control first")
        return self._generator

    def _check(self, call: str, position: Position) -> None:
        if not isinstance(goal_for(call, position, self.trans, self.name).target, Equation):
            raise MotionError(f"position {position.name} is given by joints: an object frame has none")
        self.check()
        self.generator  # noqa: B018 (raises)

    def _push(self, order: MoveOrder) -> None:
        self._settle()
        self._unwind()
        self.generator.push(order.request)
        self._motions.add(order)
        self.completed.count = 0

    def _settle(self) -> None:
        """Be where `maintain` has put the frame, if that is still to come, before it moves on from there."""
        if self._put is not None:
            self._evaluate(max(self._group.tick, self._tick + 1))

    def _unwind(self) -> None:
        """Count the turns of a frame at rest anew: near a whole one, ways about other axes would be none.

        It stays where it is, and is half a turn at most from where it has none.
        """
        q = self.generator.state()[0]
        if np.linalg.norm(q[3:]) > np.pi and self._goal_is_fixed and not (self.eventful or self._tracks):
            self._generator = self._generator_at(self._kinematics.forward(q), np.zeros(6))

    def _generator_at(self, pose: Floats, near: Floats | None = None) -> Generator:
        """A generator at rest at `pose`, with turns as at `near` (6,), or as they were."""
        if near is None:
            near = np.zeros(6) if self._generator is None else self._generator.state()[0]
        q = self._kinematics.inverse(pose, Branch.RUN, near)
        return Generator(frame_limits(), self._group.period_s, q, self._tick, kinematics=self._kinematics)

    # ------------------------------------------------------------------------------------------- once per sample

    def before_sample(self, tick: int) -> None:
        """See `GroupMember.before_sample`: the frame moves, whether or not an arm looks."""
        self._look(tick)

    def come_to_rest(self) -> None:
        """See `GroupMember.come_to_rest`: where `maintain` would have put it, it goes no more."""
        self._put = None
        if self._generator is not None and not self.rests:
            self._generator.stop()

    @property
    def busy(self) -> bool:
        """See `GroupMember.busy`."""
        return self._generator is not None and self._generator.busy

    @property
    def rests(self) -> bool:
        """See `GroupMember.rests`."""
        return self._generator is None or (not self._generator.busy and self._goal_is_fixed)

    @property
    def _goal_is_fixed(self) -> bool:
        goal = self.generator.goal
        return goal is None or goal.fixed

    def _look(self, tick: int) -> None:
        with self._group.sampled:
            if self._evaluating:
                raise MotionError(
                    f"object frame {self.name}: its own transform stands in its equation, by way of another frame"
                )
            if self._generator is not None and tick > self._tick:
                self._evaluate(tick)

    def _evaluate(self, tick: int) -> None:
        """Go on to sample `tick`. What a function raises is the program's, and brings the frame to rest."""
        self._evaluating = True
        try:
            self._go_on(tick)
        except Exception as error:
            self.error = error
            self._put = None
            self.generator.stop()
        finally:
            self._evaluating = False

    def _go_on(self, tick: int) -> None:
        self._tick = tick
        if self._put is not None:
            goal, self._put = self._put, None
            self._generator = self._generator_at(goal.pose(tick))
            self._generator.follow(goal)
            self.trans.record(tick, goal.pose(tick))
            return
        self.generator.override = self._override
        output = self.generator.update(tick)
        self.trans.record(tick, self._kinematics.forward(output.q))
        if output.events:
            self._motions.notify(output.events, output.q, tick)
            for event in output.events:
                self._hear(event)
        self._motions.update_progress(output)
        if not self._tracks and follows(self.generator):
            self._push(absolute_stop())

    @property
    def _override(self) -> float:
        """Operator's smallest override at the arms under control; 0 in a pause of one, and while one is off its path.

        What an arm was told that has ended does not count any more.
        """
        if self._group.waits:
            return 0.0
        arms = [task for task in self._group.arms.values() if task.follows_setpoints and task.td.error is None]
        return min((arm.how.motion_override for arm in arms if arm.how is not None), default=FULL_SPEED)

    def _hear(self, event: MotionEvent) -> None:
        if event.kind is EventKind.IDLE:
            self.completed.signal()
        elif event.kind is EventKind.LOST and event.code != Termination.STOPPED and self._last is not None:
            self._last.code = event.code
            why = f"{self.name} cannot follow {self._last.name} any more ({reason_of(event.code)}) and has come to rest"
            self.error = MotionError(f"{why}: maintain it again, or move")
