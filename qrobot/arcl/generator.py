"""The trajectory generator and its motion queue: ARCL's own layer round the motion engine (Corke & Kirkham, 2.4).

Called once per sample. A motion is taken out of the queue when the arm approaches the end of the one before it; the
engine joins both by a zero-jerk transition, or, when nothing waits, brings the arm smoothly to rest at the goal and
keeps it there, also when the goal moves.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from qrobot.arcl.events import ArclEvent, CallbackAnswer
from qrobot.arcl.kinematics import ManipulatorKinematics
from qrobot.arcl.machine import MachineSample
from qrobot.arcl.motion import Motion
from qrobot.arcl.segment_time import segment_time
from qrobot.arcl.trans import Trans
from qrobot.arrays import Floats
from qrobot.errors import FenceCrossed, JointLimit, MotionError, Singular, Unreachable, raise_first
from qrobot.fences.fence_set import FenceSet
from qrobot.motion import (
    FULL_SPEED,
    Blend,
    EventKind,
    Generator,
    MotionEvent,
    MoveRequest,
    Output,
    Termination,
    whole_samples,
)
from qrobot.units import S_PER_MS

if TYPE_CHECKING:
    from qrobot.arcl.kept_motions import KeptMotions

QUEUE_SIZE: Final = 64
LOOK_AHEAD_S: Final = 0.3  # [A] a transition between any two speeds of a PUMA needs no more
SETTLING: Final = 3  # samples in which the velocity of a goal that moves is found
_LONGER: Final = (1.0, 2.0, 4.0, 8.0)  # times the default Ta, where the arm cannot do with that

_ERRORS: Final = {
    Termination.JOINT_LIMIT: ArclEvent.EVENT_LIMIT,
    Termination.UNREACHABLE: ArclEvent.EVENT_REACH,
    Termination.SINGULAR: ArclEvent.EVENT_SINGULAR,
    Termination.TOO_FAST: ArclEvent.EVENT_FAST,
    Termination.FENCE: ArclEvent.EVENT_LIMIT,
}
_REASONS: Final[dict[Termination, tuple[type[MotionError], str]]] = {
    Termination.JOINT_LIMIT: (JointLimit, "a joint would leave its range"),
    Termination.UNREACHABLE: (Unreachable, "out of the arm's reach"),
    Termination.SINGULAR: (Singular, "too close to a singularity"),
    Termination.TOO_FAST: (MotionError, "a joint would be too fast"),
    Termination.FENCE: (FenceCrossed, "too near a fence"),
}


class MotionReporter(Protocol):
    """The listener whom the generator tells what happens."""

    def notify(self, event: ArclEvent, motion: Motion) -> CallbackAnswer:
        """Something happened to a motion; the answer counts for EVENT_DEQ."""

    def failed(self, event: ArclEvent, error: MotionError) -> bool:
        """An error; true to go on with the next motion, false for an orderly halt."""

    def executes(self, motion: Motion, following: Motion | None) -> None:
        """Its segment begins."""

    def feedback(self, motion: Motion, share: float, seen: MachineSample, q: Floats) -> object:
        """A sample of it; a true result ends it."""

    def ended(self, motion: Motion, seen: MachineSample) -> None:
        """The motion has ended, with `motion.code`."""


class MotionQueue:
    """The generator of one arm, behind its queue.

    Args:
        kinematics: of the arm.
        period_s: sample period.
        q: where it stands. Shape (n,).
        reporter: is told what happens.
        fences: that the arm keeps off, None for none.
        one_by_one: a motion is given when the one before it has begun, so none is shortened for want of another.

    Attributes:
        engine: the trajectory generator of the motions.
        tick: newest sample.
        period_s: as given.
        override: speed override of the program, 0 to 1; that of the operator counts besides.
        paused: the program wants its motions to stand still.
        kept: gives the setpoints while the arm is off their path, None for none.
    """

    def __init__(
        self,
        kinematics: ManipulatorKinematics,
        period_s: float,
        q: Floats,
        reporter: MotionReporter,
        fences: FenceSet | None = None,
        one_by_one: bool = False,
    ) -> None:
        self._kinematics = kinematics
        self.period_s = period_s
        self._fences, self.tick = fences, 0
        self.engine = self.engine_at(q)
        self._reporter = reporter
        self._waiting: deque[Motion] = deque()
        self._open: dict[MoveRequest, Motion] = {}
        self._current: Motion | None = None
        self._skip = False
        self.kept: KeptMotions | None = None
        self.one_by_one = one_by_one
        self.override, self.paused = FULL_SPEED, False

    @property
    def waiting(self) -> int:
        """Motions in the queue."""
        return len(self._waiting)

    @property
    def busy(self) -> bool:
        """Motions wait or are under way, or events are still to be told."""
        return bool(self._waiting) or self.moving

    @property
    def moving(self) -> bool:
        """A motion is under way, or events are still to be told; those in the queue do not count."""
        return self.engine.busy or self.engine.has_events

    def push(self, motion: Motion) -> None:
        """Queue a motion. Raises MotionError: the queue is full."""
        if len(self._waiting) >= QUEUE_SIZE:
            raise MotionError(f"move to {motion.name}: {QUEUE_SIZE} motions are waiting already, no room for more")
        self._waiting.append(motion)

    def judge(self, motion: Motion) -> None:
        """Raise what the motion would end with; one behind others that wait is judged when its turn comes."""
        if not self._waiting:
            self._try(motion, self.engine.judge)

    def stop(self, seconds: float) -> None:
        """Drop what waits, and come to rest in at least `seconds`.

        Raises Exception: the first that a function of the program has raised, once all motions are told.
        """
        if self.kept is not None:
            self.kept.give_up(seconds)
        self.engine.stop(seconds)
        failed: list[BaseException] = []
        while self._waiting:
            try:
                self._end(self._waiting.popleft(), ArclEvent.EVENT_STOP, None)
            except BaseException as error:
                failed.append(error)
        raise_first(failed, ours_too=True)

    def skip(self) -> None:
        """End the motion under way: go on to the next one, or stop if none waits."""
        self._skip = True

    def sample(self, seen: MachineSample) -> Floats:
        """The setpoints of the next sample period. Shape (n,)."""
        self.count(seen)
        override = 0.0 if self.paused else self.override * seen.override
        if self.kept is not None and (back := self.kept.setpoint(override)) is not None:
            return back
        self._dequeue(seen)
        self._take_skip()
        self._bind()
        self.engine.override = override
        output = self.engine.update(self.tick)
        for event in output.events:
            self._told(event, seen)
        self._progress(output, seen)
        if self.kept is not None:
            self.kept.note(output.q)
        return output.q

    def count(self, seen: MachineSample) -> None:
        """A sample passes, and those before it that were never heard of."""
        self.tick += 1 + seen.left_out

    def engine_at(self, q: Floats) -> Generator:
        """A trajectory generator that is at rest at `q` (n,)."""
        kinematics, fences = self._kinematics, self._fences
        return Generator(
            kinematics.limits, self.period_s, np.array(q), self.tick, Blend.ZERO_JERK, kinematics=kinematics,
            fences=fences,
        )  # fmt: skip

    # ------------------------------------------------------------------------------------------- into the engine

    def _dequeue(self, seen: MachineSample) -> None:
        """Hand the oldest motion to the engine once its time has come and nothing forbids it."""
        if not self._waiting or self.engine.waiting or self.engine.stopping or not self._due(self._waiting[0]):
            return
        motion = self._waiting[0]
        if self._reporter.notify(ArclEvent.EVENT_DEQ, motion) == CallbackAnswer.MOVE_STOP:
            return  # the engine keeps the arm at the last goal; asked again at the next sample
        if not self._waiting or self._waiting[0] is not motion:
            return  # the function has stopped the arm
        self._waiting.popleft()
        motion.t0 = seen.t_ms
        try:
            self._open[self._try(motion, self.engine.push)] = motion
        except MotionError as error:
            self._fail(_event_of(error), motion, error, seen)

    def _due(self, motion: Motion) -> bool:
        lead_s = motion.options.ta_ms * S_PER_MS + LOOK_AHEAD_S + SETTLING * self.period_s
        return self._skip or self.engine.remaining * self.period_s <= lead_s

    def _try(self, motion: Motion, give: Callable[[MoveRequest], object]) -> MoveRequest:
        """Give a motion to the engine; a transition that nobody asked for is as long as the arm needs."""
        longest = _LONGER[-1] if motion.options.tacc_ms is None else 1.0
        for longer in _LONGER:
            request = self._request(motion, longer * motion.options.ta_ms)
            try:
                give(request)
            except (JointLimit, Unreachable, Singular):
                raise
            except MotionError:
                if longer >= longest:
                    raise
            else:
                break
        return request

    def _request(self, motion: Motion, ta_ms: float) -> MoveRequest:
        to_rest = not self._waiting and not self.one_by_one
        speed = segment_time(motion.options, motion.pos, self._kinematics, ta_ms, to_rest)
        return motion.request(speed, ta_ms * S_PER_MS)

    def _take_skip(self) -> None:
        if self._skip:
            self._skip = False
            self.engine.skip(1)

    def _bind(self) -> None:
        """Tell functional transforms in which motion they are called: the one under way, before the one that waits."""
        motions = [motion for motion in reversed(self._open.values()) if motion is not self._current]
        for motion in (*motions, *((self._current,) if self._current else ())):
            for term in motion.pos.terms:
                if isinstance(term, Trans):
                    term.motion = motion

    # ---------------------------------------------------------------------------------------- out of the engine

    def _told(self, event: MotionEvent, seen: MachineSample) -> None:
        motion = None if event.request is None else self._open.get(event.request)
        if event.kind is EventKind.BEGUN and motion is not None:
            self._current, motion.begun = motion, True
            self._reporter.executes(motion, self._waiting[0] if self._waiting else None)
            self._reporter.notify(ArclEvent.EVENT_BEGIN, motion)
        elif event.kind is EventKind.ENDED and motion is not None and event.request is not None:
            del self._open[event.request]
            self._finish(motion, event, seen)
        elif event.kind is EventKind.LOST:
            self._fail(_ERRORS.get(Termination(event.code), ArclEvent.EVENT_ERROR), None, _error_of(event), seen)

    def _finish(self, motion: Motion, event: MotionEvent, seen: MachineSample) -> None:
        if (code := event.code) == Termination.COMPLETED:
            self._end(motion, ArclEvent.EVENT_DONE, seen)
        elif code > 0 or code not in _REASONS:
            self._end(motion, ArclEvent.EVENT_STOP, seen)
        else:
            self._fail(_ERRORS[Termination(code)], motion, _error_of(event, motion), seen)

    def _end(self, motion: Motion, event: ArclEvent, seen: MachineSample | None) -> None:
        motion.code = event
        if seen is not None:
            self._reporter.ended(motion, seen)
        self._reporter.notify(event, motion)

    def _fail(self, event: ArclEvent, motion: Motion | None, error: MotionError, seen: MachineSample) -> None:
        if motion is not None:
            self._end(motion, event, seen)
            self._reporter.notify(ArclEvent.EVENT_STOP, motion)
        if not self._reporter.failed(event, error):
            self.stop(0.0)

    def _progress(self, output: Output, seen: MachineSample) -> None:
        """Tell the motion under way how far it is."""
        motion = None if output.request is None else self._open.get(output.request)
        if motion is None:
            return
        ta = whole_samples(motion.options.ta_ms * S_PER_MS, self.period_s)
        if not motion.near and self.engine.serving is output.request and self.engine.remaining <= ta:
            motion.near = True
            self._reporter.notify(ArclEvent.EVENT_NEAR, motion)
        if self._reporter.feedback(motion, output.scal, seen, output.q):
            self.skip()


def _event_of(error: MotionError) -> ArclEvent:
    kinds = {
        JointLimit: ArclEvent.EVENT_LIMIT,
        Unreachable: ArclEvent.EVENT_REACH,
        Singular: ArclEvent.EVENT_SINGULAR,
        FenceCrossed: ArclEvent.EVENT_LIMIT,
    }
    return kinds.get(type(error), ArclEvent.EVENT_ERROR)


def _error_of(event: MotionEvent, motion: Motion | None = None) -> MotionError:
    kind, words = _REASONS[Termination(event.code)]
    name = "the goal that is followed" if motion is None else f"move to {motion.name}"
    return kind(f"{name}: {event.why or words}")
