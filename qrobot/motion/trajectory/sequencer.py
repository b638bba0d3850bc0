"""Sequence of segments: from rest into a request, round via points, into stops, and to rest again."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.motion.event import Termination
from qrobot.motion.path.coordinates import JOINTS
from qrobot.motion.path.path_piece import BlendSettings
from qrobot.motion.path.phase import Phase
from qrobot.motion.path.segment import Segment
from qrobot.motion.planning.planner import Planner, SegmentEntry, TransitionBounds
from qrobot.motion.planning.queued_motion import NO_FOLLOWER, Following, QueuedMotion
from qrobot.motion.planning.request_queue import RequestQueue
from qrobot.motion.planning.setpoint_check import reason
from qrobot.motion.request import MoveRequest
from qrobot.motion.trajectory.event_queue import EventQueue
from qrobot.motion.trajectory.output import Output, Passing, StopState
from qrobot.motion.trajectory.speed_override import FULL_SPEED
from qrobot.motion.trajectory.trajectory_state import TrajectoryState
from qrobot.motion.trajectory.via_point import ViaPlanner, ViaTransition
from qrobot.motion.world.limits import MotionLimits

_ROUNDING: Final = 1e-6  # samples


class Sequencer:
    """The sequence of segments of one arm.

    Args:
        planner: of the arm.
        limits: of its joints.
        settings: of the pieces of path.
        trajectory: how far it is.
        queue: requests that wait.

    Attributes:
        events: what happened, for the next output.
    """

    def __init__(
        self,
        planner: Planner,
        limits: MotionLimits,
        settings: BlendSettings,
        trajectory: TrajectoryState,
        queue: RequestQueue,
    ) -> None:
        self.events = EventQueue()
        self._planner, self._limits, self._settings = planner, limits, settings
        self._trajectory, self._path, self._queue = trajectory, trajectory.path, queue
        self._via = ViaPlanner(planner)
        self._stop: StopState | None = None  # what the stop under way ends
        self._passing: Passing | None = None
        self._skipped: tuple[Segment | None, int] | None = None  # what was under way then, and the code
        self._arrived: MoveRequest | None = None

    # -------------------------------------------------------------------------------------------------- at any time

    @property
    def busy(self) -> bool:
        """A request is being served, or waits."""
        return self._path.segment is not None or self.stopping or len(self._queue) > 0

    @property
    def stopping(self) -> bool:
        """An absolute stop is under way."""
        return self._path.phase.stopping

    @property
    def serving(self) -> MoveRequest | None:
        """The request whose segment is under way; None at rest."""
        return None if self._path.segment is None else self._path.segment.request

    @property
    def passing(self) -> MoveRequest | None:
        """The request whose via point is passed in the middle of the present transition; None from there on."""
        return None if self._passing is None else self._passing.segment.request

    def end_passing(self, code: int) -> None:
        """See `Generator.end_passing`."""
        self._pass_via_point(code)

    @property
    def requests(self) -> list[MoveRequest]:
        """Requests under way, and those whose end is still to be told."""
        segments = [self._path.segment, None if self._passing is None else self._passing.segment]
        under_way = [segment.request for segment in segments if segment is not None]
        others = [None if self._stop is None else self._stop.request, self._arrived]
        return under_way + [request for request in others if request is not None]

    def skip(self, code: int) -> None:
        """See `Generator.skip`."""
        if self.stopping:
            self._stop_sooner(None, code)
        elif self.busy:
            self._skipped = self._path.segment, code

    def stop(self, seconds: float) -> None:
        """See `Generator.stop`."""
        self._skipped = None  # of what is stopped; motions to come are not skipped
        self._drop_waiting()
        self._stay_no_longer(Termination.STOPPED)
        stands = self._path.segment is None and self._path.coordinates.fixed
        if self.stopping:
            self._stop_sooner(seconds)
        elif not stands:
            self._begin_stop(self.serving, Termination.STOPPED, seconds)

    def abort(self, code: int, why: str) -> None:
        """See `Generator.abort`."""
        if self.stopping:
            self._stay_no_longer(code, why)
            if self._trajectory.on_joint_path:
                self._stop_sooner(0.0)
            else:  # a stop on it may take long, and the path not be for the arm
                self._trajectory.begin_joint_stop(self._limits)
            return
        if self._path.segment is None:
            self.events.lost(self._arrived, code, why)
        self._drop_waiting()
        self._begin_joint_stop(self.serving, code, why=why)

    def last_end(self) -> Floats | None:
        """Position of the arm when it has done all that was asked; None when that moves. Shape (n,)."""
        if (last := self._queue.last()) is not None:
            return last.end
        if self.stopping:
            return self._trajectory.end_of_stop()
        return self._trajectory.goal_joints() if self._path.coordinates.fixed else None

    # ----------------------------------------------------------------------------------------------- once per sample

    def advance(self) -> None:
        """Begin whatever segment, transition or rest has its time come. Raises Unreachable, JointLimit or Singular."""
        self._apply_skip()
        while self._advance_segment():
            pass
        self._finish_stop()

    def pass_via_points(self) -> None:
        """Report the request whose via point is passed by now."""
        if self._passing is not None and self._is_time(self._passing.middle):
            self._pass_via_point()

    def output(self, q: Floats) -> Output:
        """Output with the setpoint `q` (n,) of this sample."""
        events = self.events.drain(self.busy)
        if self._stop is not None:
            return Output(q, self._stop.request, self._stop.scal, events, True)
        if (passing := self._passing) is None:
            return Output(q, self.serving, self._scal(), events, self.busy)
        passed = passing.segment.scal(self._trajectory.clock, self._settings.blend, ending=False)
        return Output(q, self.serving, self._scal(), events, self.busy, passing.segment.request, passed)

    # ------------------------------------------------------------------------------------- from segment to segment

    def _is_time(self, clock: float) -> bool:
        """Path time has come to `clock`, rounding apart: after another speed it is whole to 1e-10 of a sample only."""
        return self._trajectory.clock >= clock - _ROUNDING

    def _advance_segment(self) -> bool:
        """Begin the next piece of path if its time has come."""
        segment = self._path.segment
        if self._path.phase is Phase.JOINT_STOP:
            return self._finish_stop()
        if segment is None:
            return self._start()
        if self._path.phase.ending:
            return self._arrive(segment)
        return self._leave_segment(segment)

    def _start(self) -> bool:
        """Enter the oldest request from rest, or from the goal that is being followed."""
        queued = self._queue.peek()
        if queued is None or not queued.settled or self._trajectory.held:
            return False
        if queued.here:
            self._trajectory.stand_exactly()
            return self._begin_here()
        if not queued.fixed:
            self._trajectory.override.jump(FULL_SPEED)
        bounds = TransitionBounds(following=self._asked_behind(), at_any_rate=self._path.coordinates.fixed)
        if self._enter_from_state(queued, self._trajectory.goal_joints(), bounds):
            return True
        if self._queue.peek() is queued and not self._path.coordinates.fixed:
            self._begin_stop(None, Termination.COMPLETED)  # too fast a goal to leave: from rest, then
        return False

    def _leave_segment(self, segment: Segment) -> bool:
        """Enter the transition to the request that follows, or to rest, once it is time for it."""
        queued = self._follower()
        if self.stopping or segment.stays or queued is None or queued.here or not queued.settled:
            return self._approach_rest(segment)
        transition = self._transition_to(segment, queued)
        if transition is None:
            return self._approach_rest(segment)
        if not self._is_time(segment.end - transition.schedule.transition):
            return False
        return self._enter_transition(segment, queued, transition) or self._approach_rest(segment)

    def _follower(self) -> QueuedMotion | None:
        """The oldest request that waits, where it may be met in motion.

        One whose goal moves or complies knows no other speed, and in a pause such a goal is not left.
        """
        queued, fixed = self._queue.peek(), self._path.coordinates.fixed
        if queued is None or (self._trajectory.held and not fixed):
            return None
        return queued if queued.fixed or self._trajectory.override.full else None

    def _transition_to(self, segment: Segment, queued: QueuedMotion) -> ViaTransition | None:
        """Transition into `queued`, the oldest request; None when it came too late, or cannot be served at all."""
        try:
            return self._via.transition_to(segment, queued, self._trajectory, self._queue.peek(1))
        except MotionError as error:
            self._refuse(error)
            return None

    def _enter_transition(self, segment: Segment, queued: QueuedMotion, transition: ViaTransition) -> bool:
        """Enter the transition to `queued` now; False when there turned out to be no way."""
        if transition.geometry.coordinates is JOINTS and segment.coordinates is JOINTS:
            return self._enter_on_time(segment, queued, transition)
        bounds = TransitionBounds(transition.schedule.transition, following=self._asked_behind())
        on_time = None
        if segment.coordinates.fixed and queued.fixed and not self._trajectory.on_the_clock:
            on_time = segment.end - transition.schedule.transition  # which no sample meets at another speed
        return self._enter_from_state(queued, self._trajectory.goal_joints(), bounds, Termination.COMPLETED, on_time)

    def _enter_on_time(self, segment: Segment, queued: QueuedMotion, transition: ViaTransition) -> bool:
        """Enter one joint path from another as if on time, whichever samples were left out; False for a fence."""
        begin = segment.end - transition.schedule.transition
        there = self._planner.segment(queued, transition.geometry, transition.schedule, segment.end)
        entry = SegmentEntry(there, self._path.state(begin))
        if not self._planner.is_clear(entry, begin, entry.state[0]):
            return False
        self._enter(entry, begin, Termination.COMPLETED)
        return True

    def _approach_rest(self, segment: Segment) -> bool:
        """Enter the transition to rest, once it is time for it."""
        if not self._is_time(segment.rest_begin):
            return False
        self._trajectory.approach_rest(segment)
        return True

    def _arrive(self, segment: Segment) -> bool:
        """Stand exactly at the target once the transition to rest is over, or stay with it, for a sample at least."""
        if not self._is_time(self._path.piece.end):
            return False
        self._pass_via_point()  # that before it, when samples were left out
        self._trajectory.hold(segment.target)
        self._arrived = segment.request
        if self._stop is None:
            self.events.ended(segment.request, Termination.COMPLETED)
        else:
            self._end_stop(self._stop, Termination.COMPLETED)
        queued = self._queue.peek()
        return self._path.coordinates.fixed or queued is None or not queued.here

    def _enter_from_state(
        self,
        queued: QueuedMotion,
        via: Floats,
        bounds: TransitionBounds,
        code: int | None = None,
        on_time: float | None = None,
    ) -> bool:
        """Enter `queued` now, or as of path time `on_time`; the present request ends with `code`.

        False when there turned out to be no way.
        """
        trajectory = self._trajectory
        begin = trajectory.clock if on_time is None else on_time
        points = trajectory.points() if on_time is None else trajectory.points_at(on_time)
        try:
            entry = self._planner.plan_entry(queued, via, points, begin, bounds)
        except MotionError as error:
            self._refuse(error)
            return False
        if entry is None:
            return False
        self._enter(entry, begin, code)
        return True

    def _enter(self, entry: SegmentEntry, begin: float, code: int | None) -> None:
        """Take the oldest request out of the queue and follow its segment."""
        if code == Termination.COMPLETED and self._path.segment is not None:
            self._pass_via_point()  # that before it, when samples were left out
            self._passing = Passing(self._path.segment, entry.segment.begin)
        else:
            self._end_present(code)
        self._via.forget()
        self._trajectory.enter(entry, begin)
        self.events.begun(self._queue.pop().request)

    def _end_present(self, code: int | None) -> None:
        """The present request, if there is one, ends with `code`."""
        self._pass_via_point()
        if self.serving is not None and code is not None:
            self.events.ended(self.serving, code)

    def _pass_via_point(self, code: int = Termination.COMPLETED) -> None:
        """The request whose via point the path turns round has ended: half way, or cut short like the next one."""
        if self._passing is not None:
            self.events.ended(self._passing.segment.request, code)
            self._passing = None

    # --------------------------------------------------------------------------------- interruptions, stops, failures

    def _apply_skip(self) -> None:
        """End the present request if that was asked for: into the next one, or by a stop where that is not met so.

        The next one is waited for until the velocity of its goal is known.
        """
        if self._skipped is None or self._skipped[0] is not self._path.segment:
            self._skipped = None
            return
        segment, code = self._skipped
        queued = self._follower()
        if segment is not None and queued is not None and not queued.settled:
            return
        self._skipped = None
        if segment is None:
            self._drop_oldest(code)
        elif queued is None or not self._leave_for(queued, code):
            self._begin_stop(segment.request, code)

    def _drop_oldest(self, code: int) -> None:
        """The request that was to begin in this sample ends with `code`."""
        if len(self._queue):
            self.events.ended(self._queue.pop().request, code)

    def _leave_for(self, queued: QueuedMotion, code: int) -> bool:
        """Enter `queued` from where the arm is now, at the speed it has; False when no such way is safe."""
        if queued.here:
            return self._begin_here(code)
        if self._trajectory.on_joint_path and queued.target is not None:
            return self._replan(queued, code)
        via = self._planner.ahead(queued.request, self._trajectory.points())
        return self._enter_from_state(queued, via, TransitionBounds(following=self._asked_behind()), code)

    def _replan(self, queued: QueuedMotion, code: int) -> bool:
        """Replan from one joint path to another, as `_leave_for`."""
        clock = self._trajectory.clock
        try:
            entry = self._planner.replan(queued, self._path.state(clock), clock, self._asked_behind())
        except MotionError:  # from here it would be another motion than from where it was judged
            return False
        if entry is None:
            return False
        self._enter(entry, clock, code)
        return True

    def _begin_here(self, code: int = Termination.COMPLETED) -> bool:
        """Serve HERE, the oldest request: an absolute stop. The present one ends with `code`."""
        self._end_present(code)
        request = self._queue.pop().request
        self.events.begun(request)
        self._begin_stop(request, Termination.COMPLETED)
        return True

    def _begin_stop(self, request: MoveRequest | None, code: int, seconds: float | None = None) -> None:
        """Come to an absolute rest, which ends `request`: on the path in at least `seconds`, or where the joints can.

        Without `seconds` a Cartesian path is left, unless the joints would come to rest too near a fence.
        """
        self._cut_short(request, code)
        if not self._begin_path_stop(seconds):
            self._trajectory.begin_joint_stop(self._limits)

    def _stop_sooner(self, seconds: float | None, code: int | None = None) -> None:
        """Let a stop that was to take longer end in `seconds`, with `code`. As `_begin_stop`, but not over a fence."""
        stop, trajectory, planner = self._stop, self._trajectory, self._planner
        if stop is None or not trajectory.may_stop_sooner(seconds or 0.0, planner.scheduler):
            return
        self._stop = replace(stop, code=stop.code if code is None else code)
        if not self._begin_path_stop(seconds) and planner.joint_stop_is_clear(trajectory.given_points()):
            trajectory.begin_joint_stop(self._limits)

    def _begin_path_stop(self, seconds: float | None) -> bool:
        """Begin to stop on the path; False where it cannot be, or need not be."""
        segment, trajectory = self._path.segment, self._trajectory
        if segment is None or not self._path.coordinates.fixed:
            return False
        leaves = seconds is None and not trajectory.on_joint_path
        if leaves and self._planner.joint_stop_is_clear(trajectory.given_points()):
            return False
        return trajectory.begin_path_stop(segment, seconds or 0.0, self._planner.scheduler)

    def _begin_joint_stop(self, request: MoveRequest | None, code: int, why: str = "") -> None:
        """Bring the joints to rest from the newest setpoint, whatever the path was, which ends `request`."""
        self._cut_short(request, code, why)
        self._trajectory.begin_joint_stop(self._limits)

    def _cut_short(self, request: MoveRequest | None, code: int, why: str = "") -> None:
        """An absolute stop begins which ends `request`: tell so, unless the stop is what it asked for."""
        self._stop, self._skipped = StopState(request, code, self._scal(), why), None
        self._via.forget()
        self._pass_via_point()
        if request is not None and code != Termination.COMPLETED:
            self.events.interrupted(request, code)

    def _finish_stop(self) -> bool:
        """Stand where the joints, or path time, have come to rest."""
        stop = self._stop
        if stop is None or not self._trajectory.stopped:
            return False
        self._trajectory.rest_here()
        self._end_stop(stop, stop.code, stop.why)
        return True

    def _end_stop(self, stop: StopState, code: int, why: str = "") -> None:
        """End with `code` what `stop`, which is over, has served, unless the arm is to stand there for a time."""
        self._stop, request, trajectory = None, stop.request, self._trajectory
        if request is not None and stop.stays:
            stay = self._planner.stay(request, trajectory.goal_joints(), trajectory.clock)
            trajectory.enter(stay, trajectory.clock)
        elif request is not None:
            self.events.ended(request, code, why)

    def _stay_no_longer(self, code: int, why: str = "") -> None:
        """The stop under way ends with `code` as soon as the arm stands, if it was to stay."""
        if self._stop is not None and self._stop.stays:
            self._stop = replace(self._stop, code=code, why=why)

    def _refuse(self, error: MotionError) -> None:
        """The oldest request turned out to be impossible when its turn came; nothing behind it is tried."""
        self.events.ended(self._queue.pop().request, reason(error), str(error))
        self._drop_waiting()

    def _drop_waiting(self) -> None:
        self._via.forget()
        self.events.dropped(queued.request for queued in self._queue.clear())

    def _scal(self) -> float:
        """Share of the present segment that is done, 0 to 1; 1 at rest."""
        segment = self._path.segment
        ending = self._path.phase.ending
        return 1.0 if segment is None else segment.scal(self._trajectory.clock, self._settings.blend, ending)

    def _asked_behind(self) -> Following:
        """Demands of the request behind the oldest."""
        queued = self._queue.peek(1)
        return NO_FOLLOWER if queued is None else queued.asks
