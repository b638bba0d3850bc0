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

from qrobot.arrays import Floats
from qrobot.errors import JointLimit, MotionError, Singular, Unreachable
from qrobot.motion.blend import Blend, Correction
from qrobot.motion.coordinates import JOINTS
from qrobot.motion.equation import Goal
from qrobot.motion.event import Termination
from qrobot.motion.event_queue import EventQueue
from qrobot.motion.kinematics import Reach
from qrobot.motion.limits import MotionLimits
from qrobot.motion.output import Output, Passing, StopState
from qrobot.motion.path import Segment
from qrobot.motion.path_piece import BlendSettings
from qrobot.motion.planner import Planner, SegmentEntry, TransitionBounds
from qrobot.motion.queue import QUEUE_SIZE, RequestQueue
from qrobot.motion.queued_motion import NOTHING, Following, QueuedMotion
from qrobot.motion.request import MoveRequest
from qrobot.motion.setpoint_check import judge_next, reason
from qrobot.motion.trajectory_state import TrajectoryState
from qrobot.motion.via_point import ViaPlanner, ViaTransition


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
        self._shape = BlendSettings(period_s, blend, correction)
        self._planner = Planner(limits, self._shape, reach)
        self._scheduler = self._planner.scheduler
        self._reach = reach
        self._queue = RequestQueue(queue_size)
        self._at = TrajectoryState(q, tick, self._shape)
        self._path = self._at.path
        self._stop: StopState | None = None
        self._corner = ViaPlanner(self._planner)
        self._passing: Passing | None = None
        self._interrupted: tuple[Segment | None, int] | None = None  # what was under way then, and the code
        self._arrived: MoveRequest | None = None
        self._news = EventQueue()

    # -------------------------------------------------------------------------------------------------- at any time

    @property
    def waiting(self) -> int:
        """Number of requests that nobody serves yet."""
        return len(self._queue)

    @property
    def busy(self) -> bool:
        """A request is being served, or waits."""
        return self._path.segment is not None or self._stop is not None or len(self._queue) > 0

    @property
    def stopping(self) -> bool:
        """An absolute stop is under way."""
        return self._stop is not None

    @property
    def has_news(self) -> bool:
        """Events are still to be told, if only that the arm is idle; also when nothing was left to be done for them."""
        return self._news.pending

    @property
    def goal(self) -> Goal | None:
        """What is gone to, or followed, at the newest sample; None on a joint path."""
        return self._path.chart.goal

    @property
    def serving(self) -> MoveRequest | None:
        """The request whose segment is under way; None at rest."""
        return None if self._path.segment is None else self._path.segment.request

    def push(self, request: MoveRequest) -> None:
        """Queue a request; it is judged as a motion from the goal before it, from rest to rest, unless one moves.

        Raises:
            JointLimit: the goal, or a Cartesian way there, is outside the joints' range.
            Unreachable, Singular: no configuration, or not this one, reaches the goal or a place on the way.
            MotionError: the arm cannot do it in that time, or the queue is full.
        """
        self._queue.push(self._planner.prepare(request, self._last_end(), self._at.newest, self._at.tick))
        self._news.expect()

    def interrupt(self, code: int) -> None:
        """End the present request with `code` at the next sample: go on to the next one, or stop if none waits.

        A request that is about to begin ends without having begun. Does nothing at rest, nor during a stop.
        """
        if self.busy and self._stop is None:
            self._interrupted = self._path.segment, code

    def stop(self, seconds: float = 0.0) -> None:
        """Drop all waiting requests and come to an absolute rest, in at least `seconds`.

        On a joint path the arm stays on it; else it stops where its joints can.
        """
        self._drop_waiting()
        stands = self._path.segment is None and self._path.chart.fixed
        if self._stop is None and not stands:
            self._begin_stop(self.serving, Termination.STOPPED, seconds)

    def give_up(self, code: int) -> None:
        """What is under way must not go on: an absolute stop wherever the joints can, and nothing of what waits.

        The present request ends with `code`; at rest it is told that the goal which was followed is lost.
        """
        if self._stop is not None:
            return
        if self._path.segment is None:
            self._news.lost(self._arrived, code)
        self._drop_waiting()
        self._begin_halt(self.serving, code)

    def state(self) -> Floats:
        """Position, velocity and acceleration of the setpoints at the newest sample. Shape (3, n), SI units.

        Exact on joint paths; else of the parabola through the newest three setpoints.
        """
        return self._at.state()

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
        self._at.advance(tick, standing)
        self._look()
        q = self._follow()
        if self._passing is not None and self._at.clock >= self._passing.middle:
            self._pass_via_point()
        self._at.give_out(q)
        return self._output(q)

    def _look(self) -> None:
        """Evaluate what moves, and ask the monitor."""
        self._path.chart.sample(self._at.tick)
        if (errand := self._queue.peek()) is not None:
            errand.sample(self._at.tick)
        request = self.serving
        if request is not None and request.monitor is not None and (code := request.monitor()):
            self.interrupt(int(code))  # type: ignore[call-overload]

    def _follow(self) -> Floats:
        """The setpoint, kept from passing a limit."""
        try:
            q = self._next_setpoint()
        except (JointLimit, Unreachable, Singular) as error:
            self.give_up(reason(error))
            return self._at.setpoint()
        if not self._at.on_joint_path and (code := self._judged(q)) is not Termination.NONE:
            self.give_up(code)
            return self._at.setpoint()
        return q

    def _next_setpoint(self) -> Floats:
        self._take_interruption()
        while self._turn():
            pass
        self._finish_stop()
        return self._at.setpoint()

    def _judged(self, q: Floats) -> Termination:
        code = judge_next(self._at.setpoints_with(q), self.period_s, self._limits, self._shape.blend)
        if code is Termination.TOO_FAST and self._reach is not None and self._reach.near_singular(self._at.newest):
            return Termination.SINGULAR
        return code

    def _output(self, q: Floats) -> Output:
        events = self._news.take(self.busy)
        if self._stop is not None:
            return Output(q, self._stop.request, self._stop.scal, events, True)
        if (passing := self._passing) is None:
            return Output(q, self.serving, self._scal(), events, self.busy)
        passed = passing.segment.scal(self._at.clock, self._shape.blend, ending=False)
        return Output(q, self.serving, self._scal(), events, self.busy, passing.segment.request, passed)

    # ---------------------------------------------------------------------------------------------- from leg to leg

    def _turn(self) -> bool:
        """Begin the next leg if its time has come."""
        segment = self._path.segment
        if self._stop is not None and not self._stop.on_path:
            return self._finish_stop()
        if segment is None:
            return self._start()
        if self._path.ending:
            return self._arrive(segment)
        return self._leave_segment(segment)

    def _start(self) -> bool:
        """From rest, or from the goal that is being followed, into the oldest request."""
        errand = self._queue.peek()
        if errand is None or not errand.settled:
            return False
        if errand.here:
            return self._begin_here()
        room = TransitionBounds(following=self._asked_behind(), at_any_rate=self._path.chart.fixed)
        if self._depart(errand, self._at.goal_joints(), room):
            return True
        if self._queue.peek() is errand and not self._path.chart.fixed:  # too fast a goal to leave: from rest, then
            self._begin_stop(None, Termination.COMPLETED)
        return False

    def _leave_segment(self, segment: Segment) -> bool:
        """Into the transition to the request that follows, or to rest, once it is time for it."""
        errand = self._queue.peek()
        if self._stop is not None or errand is None or not errand.settled:
            return self._approach_rest(segment)
        if errand.here and not segment.chart.fixed:
            return self._at.clock >= segment.rest_begin and self._begin_here()
        way = None if errand.here else self._way_round(segment, errand)  # where it stands still it rests anyhow
        if way is None:
            return self._approach_rest(segment)
        if self._at.clock < segment.end - way.schedule.transition:
            return False
        return self._pass_corner(segment, errand, way) or self._approach_rest(segment)

    def _way_round(self, segment: Segment, errand: QueuedMotion) -> ViaTransition | None:
        """How to turn into `errand`, the oldest request; None when it came too late, or cannot be served at all."""
        try:
            return self._corner.way_round(segment, errand, self._at, self._queue.peek(1))
        except MotionError as error:
            self._refuse(error)
            return None

    def _pass_corner(self, segment: Segment, errand: QueuedMotion, way: ViaTransition) -> bool:
        """Into the transition to `errand` now; False when there turned out to be no way."""
        if way.course.chart is JOINTS and segment.chart is JOINTS:
            self._round_exactly(segment, errand, way)
            return True
        room = TransitionBounds(way.schedule.transition, following=self._asked_behind())
        return self._depart(errand, self._at.goal_joints(), room, Termination.COMPLETED)

    def _round_exactly(self, segment: Segment, errand: QueuedMotion, way: ViaTransition) -> None:
        """From one joint path into another, beginning when it should have, whichever samples were left out."""
        begin = segment.end - way.schedule.transition
        there = self._planner.segment(errand, way.course, way.schedule, segment.end)
        self._enter(SegmentEntry(there, self._path.state(begin)), begin, Termination.COMPLETED)

    def _approach_rest(self, segment: Segment) -> bool:
        """Into the transition to rest, once it is time for it."""
        if self._at.clock < segment.rest_begin:
            return False
        self._at.approach_rest(segment)
        return True

    def _arrive(self, segment: Segment) -> bool:
        """Stand exactly at the target once the transition to rest is over."""
        if self._at.clock < self._path.leg.end:
            return False
        self._at.hold(segment.target)
        self._arrived = segment.request
        ended = segment.request if self._stop is None else self._stop.request
        self._stop = None
        if ended is not None:
            self._news.ended(ended, Termination.COMPLETED)
        return True

    def _depart(self, errand: QueuedMotion, corner: Floats, room: TransitionBounds, code: int | None = None) -> bool:
        """Into `errand` now; the present request ends with `code`. False when there turned out to be no way."""
        points = self._at.points()
        try:
            departure = self._planner.depart(errand, corner, points, self._at.clock, room)
        except MotionError as error:
            self._refuse(error)
            return False
        if departure is None:
            return False
        self._enter(departure, self._at.clock, code)
        return True

    def _enter(self, departure: SegmentEntry, begin: float, code: int | None) -> None:
        """Take the oldest request out of the queue and follow its segment."""
        if code == Termination.COMPLETED and self._path.segment is not None:
            self._passing = Passing(self._path.segment, departure.segment.begin)
        else:
            self._end_present(code)
        self._corner.forget()
        self._at.enter(departure, begin)
        self._news.begun(self._queue.pop().request)

    def _end_present(self, code: int | None) -> None:
        """The present request, if there is one, ends with `code`."""
        self._pass_via_point()
        if self.serving is not None and code is not None:
            self._news.ended(self.serving, code)

    def _pass_via_point(self) -> None:
        """The request whose via point the path turns round has ended: half way, or cut short like the next one."""
        if self._passing is not None:
            self._news.ended(self._passing.segment.request, Termination.COMPLETED)
            self._passing = None

    # --------------------------------------------------------------------------------- interruptions, stops, failures

    def _take_interruption(self) -> None:
        """End the present request if that was asked for, as soon as the next one can begin."""
        if self._interrupted is None or self._interrupted[0] is not self._path.segment:
            self._interrupted = None
            return
        segment, code = self._interrupted
        errand = self._queue.peek()
        if segment is not None and errand is not None and not errand.settled:
            return
        self._interrupted = None
        if segment is None:
            self._drop_oldest(code)
            return
        if errand is None or not self._leave_for(errand, code):
            self._begin_stop(segment.request, code)

    def _drop_oldest(self, code: int) -> None:
        """The request that was to begin in this sample ends with `code`."""
        if self.waiting:
            self._news.ended(self._queue.pop().request, code)

    def _leave_for(self, errand: QueuedMotion, code: int) -> bool:
        """From where the arm is now, at the speed it has, into `errand`; False when no such way is safe."""
        if errand.here:
            return self._begin_here(code)
        if self._at.on_joint_path and errand.target is not None:
            return self._divert(errand, code)
        corner = self._planner.ahead(errand.request, self._at.points())
        return self._depart(errand, corner, TransitionBounds(following=self._asked_behind()), code)

    def _divert(self, errand: QueuedMotion, code: int) -> bool:
        """As `_leave_for`, from one joint path to another."""
        clock = self._at.clock
        departure = self._planner.divert(errand, self._path.state(clock), clock, self._asked_behind())
        if departure is None:
            return False
        self._enter(departure, clock, code)
        return True

    def _begin_here(self, code: int = Termination.COMPLETED) -> bool:
        """Serve HERE, the oldest request: an absolute stop. The present one ends with `code`."""
        self._end_present(code)
        request = self._queue.pop().request
        self._news.begun(request)
        self._begin_stop(request, Termination.COMPLETED)
        return True

    def _begin_stop(self, request: MoveRequest | None, code: int, seconds: float = 0.0) -> None:
        """Come to an absolute rest, which ends `request`: on a joint path, or wherever the joints can."""
        segment = self._path.segment
        if not self._at.on_joint_path or segment is None:
            self._begin_halt(request, code, seconds)
            return
        self._cut_short(request, code, on_path=True)
        self._at.brake(segment, seconds, self._scheduler)

    def _begin_halt(self, request: MoveRequest | None, code: int, seconds: float = 0.0) -> None:
        """Bring the joints to rest from the newest setpoint, whatever the path was, which ends `request`."""
        self._cut_short(request, code, on_path=False)
        self._at.halt(seconds, self._limits)

    def _cut_short(self, request: MoveRequest | None, code: int, on_path: bool) -> None:
        """An absolute stop begins which ends `request`: tell so, unless the stop is what it asked for."""
        self._stop = StopState(request, code, self._scal(), on_path)
        self._corner.forget()
        self._pass_via_point()
        if request is not None and code != Termination.COMPLETED:
            self._news.interrupted(request, code)

    def _finish_stop(self) -> bool:
        """Stand where the joints, or path time, have come to rest."""
        stop = self._stop
        if stop is None or not self._at.stopped:
            return False
        self._at.hold(self._path.state(self._at.clock)[0])
        self._stop = None
        if stop.request is not None:
            self._news.ended(stop.request, stop.code)
        return True

    def _refuse(self, error: MotionError) -> None:
        """The oldest request turned out to be impossible when its turn came; nothing behind it is tried."""
        self._news.ended(self._queue.pop().request, reason(error))
        self._drop_waiting()

    def _drop_waiting(self) -> None:
        self._corner.forget()
        self._news.dropped(errand.request for errand in self._queue.clear())

    # ------------------------------------------------------------------------------------------------------- helpers

    def _scal(self) -> float:
        """How much of the present segment is done, 0 to 1; 1 at rest."""
        segment = self._path.segment
        return 1.0 if segment is None else segment.scal(self._at.clock, self._shape.blend, self._path.ending)

    def _asked_behind(self) -> Following:
        """What the request behind the oldest asks for."""
        errand = self._queue.peek(1)
        return NOTHING if errand is None else errand.asks

    def _last_end(self) -> Floats | None:
        """Where the arm will be when it has done all that was asked; None when that moves. Shape (n,)."""
        if (last := self._queue.last()) is not None:
            return last.end
        if not self._path.chart.fixed or (self._stop is not None and not self._stop.on_path):
            return None
        return self._at.goal_joints()
