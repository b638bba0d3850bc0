"""The trajectory generator: requests go in at any time, one setpoint per joint comes out per sample.

    generator = Generator(motion_limits(robot), 0.028, q)
    generator.push(MoveRequest("park", q_park, JointSpeed(0.35)))
    while (output := generator.update(tick)).moving:
        tick += 1

A request becomes a segment between two corners of the path, straight in the coordinates of its chart (chart.py). When
another request follows in time, the path turns round the corner in a transition and never reaches it; otherwise the arm
comes to rest there, relative to the goal when the goal moves, and stays with it. Position, velocity and acceleration of
the setpoints are continuous whatever happens. On joint paths they are planned within the limits; of other setpoints,
whose goals may move, each is judged before it goes out, and an absolute stop takes the place of one that must not be.
"""

from __future__ import annotations

from qrobot.errors import JointLimit, MotionError, Singular, Unreachable
from qrobot.motion.blend import Blend, Correction
from qrobot.motion.brake import Brake, fitting_brake
from qrobot.motion.chart import JOINTS
from qrobot.motion.course import Course
from qrobot.motion.equation import Goal
from qrobot.motion.errand import Errand
from qrobot.motion.events import Termination
from qrobot.motion.leg import Shape
from qrobot.motion.limits import Floats, MotionLimits
from qrobot.motion.news import News
from qrobot.motion.output import Halt, Output
from qrobot.motion.path import Path, Segment
from qrobot.motion.planner import Departure, Planner, Room
from qrobot.motion.queue import QUEUE_SIZE, RequestQueue
from qrobot.motion.reach import Reach
from qrobot.motion.request import MoveRequest
from qrobot.motion.schedule import Schedule
from qrobot.motion.trail import Samples, Trail, true_joints
from qrobot.motion.watch import halting_s, judge_next, reason


class Generator:
    """Motion of one arm.

    Args:
        limits: of the arm.
        period_s: sample period.
        q: setpoint to begin at, at rest. Shape (n,).
        tick: number of that sample.
        blend: polynomial of the transitions.
        queue_size: how many requests may wait.
        reach: kinematics of the arm; without them only joint positions can be gone to.
        correction: polynomial that fades out a velocity the transition did not expect.
    """

    def __init__(
        self,
        limits: MotionLimits,
        period_s: float,
        q: Floats,
        tick: int = 0,
        blend: Blend = Blend.QUARTIC,
        queue_size: int = QUEUE_SIZE,
        reach: Reach | None = None,
        correction: Correction = Correction.SMOOTH,
    ) -> None:
        self.period_s = period_s
        self._limits = limits
        self._shape = Shape(period_s, blend, correction)
        self._planner = Planner(limits, self._shape, reach)
        self._scheduler = self._planner.scheduler
        self._reach = reach
        self._queue = RequestQueue(queue_size)
        self._path = Path(q, self._shape)
        self._trail = Trail(tick, q)
        self._truth = Trail(tick, q)  # as the trail, but of joints that follow no setpoints where they really are
        self._standing: Floats | None = None
        self._tick = tick
        self._clock = 0.0  # path time, in samples; as fast as the ticks except during a brake
        self._told_clock = 0.0  # path time of the newest setpoint given out
        self._brake: Brake | None = None
        self._brake_tick = 0
        self._halt: Halt | None = None
        self._planned: tuple[Errand, Course, Schedule | None] | None = None  # the way round the next corner
        self._interrupted: tuple[Segment, int] | None = None
        self._arrived: MoveRequest | None = None
        self._news = News()

    # -------------------------------------------------------------------------------------------------- at any time

    @property
    def waiting(self) -> int:
        """Number of requests that nobody serves yet."""
        return len(self._queue)

    @property
    def busy(self) -> bool:
        """A request is being served, or waits."""
        return self._path.segment is not None or self._halt is not None or len(self._queue) > 0

    @property
    def goal(self) -> Goal | None:
        """What is gone to, or followed, at the newest sample; None on a joint path."""
        return self._path.chart.goal

    def push(self, request: MoveRequest) -> None:
        """Queue a request; it is judged as a motion from the goal before it, from rest to rest, unless one moves.

        Raises:
            JointLimit: the goal, or a Cartesian way there, is outside the joints' range.
            Unreachable, Singular: no configuration, or not this one, reaches the goal or a place on the way.
            MotionError: the arm cannot do it in that time, or the queue is full.
        """
        self._queue.push(self._planner.prepare(request, self._last_end(), self._trail.newest, self._tick))
        self._news.expect()

    def interrupt(self, code: int) -> None:
        """End the present request with `code` at the next sample: go on to the next one, or stop if none waits.

        Does nothing at rest, nor during a stop.
        """
        segment = self._path.segment
        if segment is not None and self._brake is None and self._halt is None:
            self._interrupted = segment, code

    def stop(self, seconds: float = 0.0) -> None:
        """Drop all waiting requests and come to an absolute rest, in at least `seconds`.

        On a joint path the arm stays on it; else it stops where its joints can.
        """
        self._drop_waiting()
        segment = self._path.segment
        if self._brake is not None or self._halt is not None:
            return
        if segment is None and self._path.chart.fixed:
            return  # it stands
        if self._path.chart is not JOINTS:
            self._begin_halt(self.serving, Termination.STOPPED, seconds)
        elif segment is not None:
            self._begin_brake(segment, Termination.STOPPED, seconds)

    def state(self) -> Floats:
        """Position, velocity and acceleration of the setpoints at the newest sample. Shape (3, n), SI units.

        Exact on joint paths; else of the parabola through the newest three setpoints.
        """
        if self._path.chart is not JOINTS:
            return self._trail.state(self.period_s)
        if self._brake is None:
            return self._path.state(self._clock)
        return self._path.state(*self._brake.at(self._tick - self._brake_tick))

    # ----------------------------------------------------------------------------------------------- once per sample

    def update(self, tick: int, standing: Floats | None = None) -> Output:
        """Setpoints of sample `tick`.

        Args:
            tick: its number.
            standing: where joints are that follow no setpoints, NaN on all others: what comes next begins there.
                Shape (n,).

        Raises:
            MotionError: it is not later than the sample before.
            Exception: whatever a functional transform or a monitor raised.
        """
        if tick <= self._tick:
            raise MotionError(f"sample {tick} asked for after sample {self._tick}")
        self._standing = standing
        self._advance(tick)
        self._look()
        q = self._follow()
        self._trail.append(tick, q)
        self._truth.append(tick, true_joints(q, standing))
        self._told_clock = self._clock
        return self._output(q)

    def _advance(self, tick: int) -> None:
        if self._brake is None:
            self._clock += tick - self._tick
        else:
            self._clock = self._brake.at(tick - self._brake_tick)[0]
        self._tick = tick

    def _look(self) -> None:
        """Evaluate what moves, and ask the monitor."""
        self._path.chart.sample(self._tick)
        if (errand := self._queue.peek()) is not None:
            errand.sample(self._tick)
        segment = self._path.segment
        if segment is not None and segment.request.monitor is not None and (code := segment.request.monitor()):
            self.interrupt(int(code))  # type: ignore[call-overload]

    def _follow(self) -> Floats:
        """The setpoint, kept from passing a limit."""
        try:
            q = self._next_setpoint()
        except (JointLimit, Unreachable, Singular) as error:
            self._give_up(reason(error))
            return self._path.joints(self._clock)
        if self._path.chart is not JOINTS and (code := self._judged(q)) is not Termination.NONE:
            self._give_up(code)
            return self._path.joints(self._clock)
        return q

    def _next_setpoint(self) -> Floats:
        self._take_interruption()
        while self._turn():
            pass
        self._finish_brake()
        return self._path.joints(self._clock)

    def _judged(self, q: Floats) -> Termination:
        code = judge_next(self._trail.with_now(self._tick, q), self.period_s, self._limits, self._shape.blend)
        if code is Termination.TOO_FAST and self._reach is not None and self._reach.near_singular(self._trail.newest):
            return Termination.SINGULAR
        return code

    def _output(self, q: Floats) -> Output:
        events = self._news.take(self.busy)
        segment, halt = self._path.segment, self._halt
        if halt is not None:
            return Output(q, halt.request, halt.scal, events, True)
        if segment is None:
            return Output(q, None, 1.0, events, self.busy)
        return Output(q, segment.request, self._scal(segment, self._clock), events, True)

    # ---------------------------------------------------------------------------------------------- from leg to leg

    def _turn(self) -> bool:
        """Begin the next leg if its time has come."""
        segment = self._path.segment
        if self._halt is not None:
            return self._finish_halt(self._halt)
        if segment is None:
            return self._start()
        if self._path.ending:
            return self._arrive(segment)
        if self._brake is None and self._pass_corner(segment):
            return True
        return self._approach_rest(segment)

    def _start(self) -> bool:
        """From rest, or from the goal that is being followed, into the oldest request."""
        errand = self._queue.peek()
        if errand is None or self._brake is not None or not errand.settled:
            return False
        if errand.here:
            return self._begin_here()
        return self._depart(errand, self._path.goal_joints(self._trail.newest), Room(following=self._ta_after()))

    def _pass_corner(self, segment: Segment) -> bool:
        """Into the transition to the request that follows, once it is time for it."""
        errand = self._queue.peek()
        if errand is None or not errand.settled:
            return False
        if errand.here:
            return self._clock >= segment.rest_begin and self._begin_here(Termination.COMPLETED)
        course, schedule = self._way_round(segment, errand)
        if course is None or schedule is None or self._clock < segment.end - schedule.transition:
            return False
        if course.chart is JOINTS and segment.chart is JOINTS:  # exact, whichever samples were left out
            begin = segment.end - schedule.transition
            there = self._planner.segment(errand, course, schedule, segment.end)
            self._enter(Departure(there, self._path.state(begin)), begin, Termination.COMPLETED)
            return True
        room = Room(schedule.transition, following=self._ta_after())
        return self._depart(errand, self._path.goal_joints(self._trail.newest), room, Termination.COMPLETED)

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
        self._path.hold(segment.target, self._clock)
        self._brake = None
        self._arrived = segment.request
        self._news.ended(segment.request, Termination.COMPLETED)
        return True

    def _way_round(self, segment: Segment, errand: Errand) -> tuple[Course | None, Schedule | None]:
        """How to turn into `errand` at the end of `segment`; None when it came too late for that, or cannot be."""
        if self._planned is None or self._planned[0] is not errand:
            room = segment.end - max(self._clock, self._path.leg.end)
            course = self._lay(errand, self._path.goal_joints(self._trail.newest))
            if course is None:
                return None, None
            bounds = segment.schedule.braking, int(room), self._ta_after()
            schedule = self._scheduler.plan(errand.request, course, segment.arriving, *bounds)
            self._planned = errand, course, schedule if schedule.transition <= room else None
        return self._planned[1], self._planned[2]

    def _lay(self, errand: Errand, corner: Floats) -> Course | None:
        try:
            return self._planner.lay(errand, corner)
        except MotionError as error:
            self._refuse(error)
            return None

    def _depart(self, errand: Errand, corner: Floats, room: Room, code: int | None = None) -> bool:
        """Into `errand` now; the present request ends with `code`. False when there turned out to be no way."""
        points = self._points()
        try:
            departure = self._planner.depart(errand, corner, points, self._clock, room)
        except MotionError as error:
            self._refuse(error)
            return False
        self._enter(departure, self._clock, code)
        return True

    def _enter(self, departure: Departure, begin: float, code: int | None) -> None:
        """Take the oldest request out of the queue and follow its segment."""
        if self._path.segment is not None and code is not None:
            self._news.ended(self._path.segment.request, code)
        self._planned = None
        self._trail = self._truth.copy()
        self._path.enter(departure.segment, begin, departure.state)
        self._news.begun(self._queue.pop().request)

    # --------------------------------------------------------------------------------- interruptions, stops, failures

    def _take_interruption(self) -> None:
        """End the present request if that was asked for, as soon as the next one can begin."""
        if self._interrupted is None or self._interrupted[0] is not self._path.segment:
            self._interrupted = None
            return
        segment, code = self._interrupted
        errand = self._queue.peek()
        if errand is not None and not errand.settled:
            return
        self._interrupted = None
        if errand is None:
            self._begin_stop(segment, code)
        elif errand.here:
            self._begin_here(code)
        elif self._path.chart is JOINTS and errand.target is not None:
            self._divert(segment, errand, code)
        else:
            corner = self._planner.ahead(errand.request, self._points())
            if not self._depart(errand, corner, Room(following=self._ta_after()), code):
                self._begin_stop(segment, code)

    def _divert(self, segment: Segment, errand: Errand, code: int) -> None:
        """From where the arm is now, at the speed it has, into `errand`; a stop when no such way is safe."""
        departure = self._planner.divert(errand, self._path.state(self._clock), self._clock, self._ta_after())
        if departure is None:
            self._begin_stop(segment, code)
        else:
            self._enter(departure, self._clock, code)

    def _begin_stop(self, segment: Segment, code: int) -> None:
        if self._path.chart is JOINTS:
            self._begin_brake(segment, code, 0.0)
        else:
            self._begin_halt(segment.request, code, 0.0)

    def _begin_brake(self, segment: Segment, code: int, seconds: float) -> None:
        """Come to rest on the path, which stands still."""
        self._planned = None
        if not self._path.ending and self._clock > segment.rest_begin:  # a request that was to follow is gone
            self._path.end_segment(segment, self._clock)
        self._brake = fitting_brake(self._path, self._clock, code, seconds, self._scheduler)
        self._brake_tick = self._tick

    def _finish_brake(self) -> None:
        """Stand where path time has come to a halt."""
        brake, segment = self._brake, self._path.segment
        if brake is None or segment is None or self._tick - self._brake_tick < brake.length:
            return
        self._path.hold(self._path.state(self._clock)[0], self._clock)
        self._brake = None
        self._news.ended(segment.request, brake.code)

    def _begin_here(self, code: int | None = None) -> bool:
        """Serve HERE, the oldest request: an absolute stop. The present one ends with `code`."""
        segment = self._path.segment
        if segment is not None and code is not None:
            self._news.ended(segment.request, code)
        request = self._queue.pop().request
        self._news.begun(request)
        self._begin_halt(request, Termination.COMPLETED, 0.0)
        return True

    def _begin_halt(self, request: MoveRequest | None, code: int, seconds: float) -> None:
        """Bring the joints to rest from the newest setpoint, whatever the path was."""
        joint_path = self._path.chart is JOINTS
        state = self._path.state(self._told_clock) if joint_path else self._truth.state(self.period_s)
        self._trail = self._truth.copy()
        length_s = max(seconds, halting_s(state[1], self._limits, self._shape.blend))
        scal = 1.0 if self._path.segment is None else self._scal(self._path.segment, self._told_clock)
        self._halt = Halt(request, code, scal)
        self._planned = self._brake = None
        self._path.halt(state, self._told_clock, length_s / self.period_s)

    def _finish_halt(self, halt: Halt) -> bool:
        """Stand where the joints have come to rest."""
        if self._clock < self._path.leg.end:
            return False
        self._path.hold(self._path.state(self._path.leg.end)[0], self._clock)
        self._halt = None
        if halt.request is not None:
            self._news.ended(halt.request, halt.code)
        return True

    def _give_up(self, code: Termination) -> None:
        """The setpoint of this sample must not be: an absolute stop instead, and nothing of what waits."""
        if self._path.segment is None:
            self._news.lost(self._arrived, code)
        self._drop_waiting()
        self._begin_halt(self.serving, code, 0.0)

    def _refuse(self, error: MotionError) -> None:
        """The oldest request turned out to be impossible when its turn came; nothing behind it is tried."""
        self._news.ended(self._queue.pop().request, reason(error))
        self._drop_waiting()

    def _drop_waiting(self) -> None:
        self._planned = None
        self._news.dropped(errand.request for errand in self._queue.clear())

    # ------------------------------------------------------------------------------------------------------- helpers

    @property
    def serving(self) -> MoveRequest | None:
        """The request whose segment is under way; None at rest."""
        return None if self._path.segment is None else self._path.segment.request

    def _scal(self, segment: Segment, clock: float) -> float:
        return segment.scal(clock, self._shape.blend, self._path.ending)

    def _points(self) -> Samples:
        """The newest setpoints, that of this sample included."""
        q = true_joints(self._path.joints(self._clock), self._standing)
        return self._truth.with_now(self._tick, q)

    def _ta_after(self) -> int:
        """Ta that the request behind the oldest asks for, 0 when there is none."""
        errand = self._queue.peek(1)
        return 0 if errand is None else self._scheduler.preferred(errand.request)

    def _last_end(self) -> Floats | None:
        """Where the arm will be when it has done all that was asked; None when that moves. Shape (n,)."""
        if (last := self._queue.last()) is not None:
            return last.end
        if not self._path.chart.fixed or self._halt is not None:
            return None
        return self._path.goal_joints(self._trail.newest)
