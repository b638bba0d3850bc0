"""The trajectory generator: requests go in at any time, one setpoint per joint comes out per sample.

    generator = Generator(motion_limits(robot), 0.028, q)
    generator.push(MoveRequest("park", q_park, JointSpeed(0.35)))
    while (output := generator.update(tick)).moving:
        tick += 1

A request becomes a segment between two corners of the path. When another request follows in time, the path turns round
the corner in a transition and never reaches it; otherwise the arm comes to rest there. Position, velocity and
acceleration of the setpoints are continuous whatever happens, and stay within the limits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qrobot.errors import MotionError
from qrobot.motion.blend import Blend
from qrobot.motion.brake import Brake, fitting_brake
from qrobot.motion.diversion import divert
from qrobot.motion.events import EventKind, MotionEvent, Termination
from qrobot.motion.limits import Floats, MotionLimits
from qrobot.motion.path import Path, Segment
from qrobot.motion.queue import QUEUE_SIZE, RequestQueue
from qrobot.motion.request import MoveRequest
from qrobot.motion.schedule import Schedule, Scheduler


@dataclass(frozen=True, eq=False)
class Output:
    """One sample.

    Attributes:
        q: joint setpoints, rad or m. Shape (n,).
        request: being served, None at rest.
        scal: how much of its segment is done, 0 to 1; 1 at rest.
        events: what happened since the sample before, oldest first.
        moving: a request is being served, or waits.
    """

    q: Floats
    request: MoveRequest | None
    scal: float
    events: tuple[MotionEvent, ...]
    moving: bool


class Generator:
    """Joint-interpolated motion of one arm.

    Args:
        limits: of the arm.
        period_s: sample period.
        q: setpoint to begin at, at rest. Shape (n,).
        tick: number of that sample.
        blend: polynomial of the transitions.
        queue_size: how many requests may wait.
    """

    def __init__(
        self,
        limits: MotionLimits,
        period_s: float,
        q: Floats,
        tick: int = 0,
        blend: Blend = Blend.QUARTIC,
        queue_size: int = QUEUE_SIZE,
    ) -> None:
        self.period_s = period_s
        self._limits = limits
        self._blend = blend
        self._scheduler = Scheduler(limits, period_s, blend)
        self._queue = RequestQueue(queue_size)
        self._path = Path(q, period_s, blend)
        self._tick = tick
        self._clock = 0.0  # path time, in samples; as fast as the ticks except during a stop
        self._brake: Brake | None = None
        self._brake_tick = 0
        self._planned: tuple[MoveRequest, Schedule | None] | None = None  # the way round the next corner
        self._told_idle = True
        self._events: list[MotionEvent] = []

    # -------------------------------------------------------------------------------------------------- at any time

    @property
    def waiting(self) -> int:
        """Number of requests that nobody serves yet."""
        return len(self._queue)

    @property
    def busy(self) -> bool:
        """A request is being served, or waits."""
        return self._path.segment is not None or len(self._queue) > 0

    def push(self, request: MoveRequest) -> None:
        """Queue a request; it is judged as a motion from the target before it, from rest to rest.

        Raises:
            JointLimit: the target is outside the joints' range.
            MotionError: the arm cannot do it in that time, or the queue is full.
        """
        self._scheduler.check(request, self._last_target())
        self._queue.push(request)
        self._told_idle = False

    def interrupt(self, code: int) -> None:
        """End the present request with `code` now: go on to the next one, or stop on the path if none waits.

        Does nothing at rest, nor during a stop.
        """
        present = self._path.segment
        if present is None or self._brake is not None:
            return
        request = self._queue.peek()
        segment = None if request is None else self._diversion(request)
        if segment is None:
            self._begin_stop(present, code, 0.0)
        else:
            self._end(present, code)
            self._enter(segment, self._clock)

    def stop(self, seconds: float = 0.0) -> None:
        """Drop all waiting requests and come to rest on the path, in at least `seconds`."""
        self._events += [MotionEvent(EventKind.ENDED, request, Termination.STOPPED) for request in self._queue.clear()]
        if self._path.segment is not None and self._brake is None:
            self._begin_stop(self._path.segment, Termination.STOPPED, seconds)

    def state(self) -> Floats:
        """Position, velocity and acceleration of the setpoints at the newest sample. Shape (3, n), SI units."""
        if self._brake is None:
            return self._path.state(self._clock)
        return self._path.state(*self._brake.at(self._tick - self._brake_tick))

    # ----------------------------------------------------------------------------------------------- once per sample

    def update(self, tick: int) -> Output:
        """Setpoints of sample `tick`. Raises MotionError when it is not later than the sample before."""
        if tick <= self._tick:
            raise MotionError(f"sample {tick} asked for after sample {self._tick}")
        self._advance(tick)
        while self._turn():
            pass
        self._finish_stop()
        return self._output()

    def _advance(self, tick: int) -> None:
        if self._brake is None:
            self._clock += tick - self._tick
        else:
            self._clock = self._brake.at(tick - self._brake_tick)[0]
        self._tick = tick

    def _output(self) -> Output:
        segment = self._path.segment
        if not self.busy and not self._told_idle:
            self._told_idle = True
            self._events.append(MotionEvent(EventKind.IDLE))
        events, self._events = tuple(self._events), []
        q = self._path.state(self._clock)[0]
        if segment is None:
            return Output(q, None, 1.0, events, self.busy)
        return Output(q, segment.request, segment.scal(self._clock), events, self.busy)

    # ---------------------------------------------------------------------------------------------- from leg to leg

    def _turn(self) -> bool:
        """Begin the next leg if its time has come."""
        segment = self._path.segment
        if segment is None:
            return self._start()
        if self._path.ending:
            return self._arrive(segment)
        if self._brake is None and self._pass_corner(segment):
            return True
        return self._approach_rest(segment)

    def _start(self) -> bool:
        """From rest into the oldest request."""
        request = self._queue.peek()
        if request is None or self._brake is not None:
            return False
        distance = request.target - self._path.leg.rows[0]
        schedule = self._scheduler.plan(request, distance, np.zeros_like(distance), following=self._transition_after())
        self._enter(self._segment(request, self._clock + schedule.transition, schedule, distance), self._clock)
        return True

    def _pass_corner(self, segment: Segment) -> bool:
        """Into the transition to the request that follows, once it is time for it."""
        request = self._queue.peek()
        schedule = self._way_round(segment, request) if request is not None else None
        if request is None or schedule is None or self._clock < segment.end - schedule.transition:
            return False
        distance = request.target - segment.request.target
        self._end(segment, Termination.COMPLETED)
        self._enter(self._segment(request, segment.end, schedule, distance), segment.end - schedule.transition)
        return True

    def _approach_rest(self, segment: Segment) -> bool:
        """Into the transition to rest, once it is time for it."""
        if self._clock < segment.rest_begin:
            return False
        self._path.end_segment(segment, segment.rest_begin)
        return True

    def _arrive(self, segment: Segment) -> bool:
        """Stand exactly at the target once the transition to rest is over."""
        if self._clock < self._path.leg.end:
            return False
        self._path.hold(segment.request.target, self._clock)
        self._brake = None
        self._end(segment, Termination.COMPLETED)
        return True

    def _way_round(self, segment: Segment, request: MoveRequest) -> Schedule | None:
        """How to turn into `request` at the end of `segment`; None when it came too late for that."""
        if self._planned is None or self._planned[0] is not request:
            room = segment.end - max(self._clock, self._path.leg.end)
            schedule = self._scheduler.plan(
                request, request.target - segment.request.target, segment.velocity,
                least=segment.schedule.braking, most=int(room), following=self._transition_after(),
            )  # fmt: skip
            self._planned = request, schedule if schedule.transition <= room else None
        return self._planned[1]

    def _segment(self, request: MoveRequest, corner: float, schedule: Schedule, distance: Floats) -> Segment:
        return Segment(request, corner, schedule, self._path.velocity_on(schedule, distance))

    def _enter(self, segment: Segment, begin: float) -> None:
        """Take the oldest request out of the queue and follow its segment."""
        self._planned = None
        self._path.enter(segment, begin)
        self._events.append(MotionEvent(EventKind.BEGUN, self._queue.pop()))

    def _end(self, segment: Segment, code: int) -> None:
        """Tell how a request ended."""
        self._events.append(MotionEvent(EventKind.ENDED, segment.request, code))

    # ----------------------------------------------------------------------------------------------- interruptions

    def _diversion(self, request: MoveRequest) -> Segment | None:
        """The way from where the arm is now, at the speed it has, into `request`; None when no such way is safe."""
        return divert(request, self._path.state(self._clock), self._clock, self._scheduler, self._transition_after())

    def _begin_stop(self, segment: Segment, code: int, seconds: float) -> None:
        self._planned = None
        if not self._path.ending and self._clock > segment.rest_begin:  # a request that was to follow is gone
            self._path.end_segment(segment, self._clock)
        self._brake = fitting_brake(self._path, self._clock, code, seconds, self._scheduler)
        self._brake_tick = self._tick

    def _finish_stop(self) -> None:
        """Stand where path time has come to a halt."""
        brake, segment = self._brake, self._path.segment
        if brake is None or segment is None or self._tick - self._brake_tick < brake.length:
            return
        self._path.hold(self._path.state(self._clock)[0], self._clock)
        self._brake = None
        self._end(segment, brake.code)

    # ------------------------------------------------------------------------------------------------------- helpers

    def _transition_after(self) -> int:
        """Ta that the request behind the oldest asks for, 0 when there is none."""
        request = self._queue.peek(1)
        return 0 if request is None else self._scheduler.preferred(request)

    def _last_target(self) -> Floats:
        """Where the arm will be when it has done all that was asked. Shape (n,)."""
        if (last := self._queue.last()) is not None:
            return last.target
        segment = self._path.segment
        return segment.request.target if segment is not None else self._path.leg.rows[0]
