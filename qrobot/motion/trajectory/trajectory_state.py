"""State of an arm's trajectory: its path, the time on it, and the setpoints it was given last.

Path time is counted in samples. It passes as the clock does, except at another speed (speed_override.py) and in a stop
on the path, where it slows down and stands still (path_stop.py).
"""

from __future__ import annotations

from collections import deque
from typing import Final, NamedTuple

from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.motion.event import MotionEvent
from qrobot.motion.path.coordinates import JOINTS, DriveCoordinates
from qrobot.motion.path.goal_tracker import GoalTracker
from qrobot.motion.path.path import Path
from qrobot.motion.path.path_piece import BlendSettings, PathPiece
from qrobot.motion.path.phase import Phase
from qrobot.motion.path.segment import Segment
from qrobot.motion.path.setpoint_history import DEPTH, History, SetpointHistory, true_joints
from qrobot.motion.planning.joint_stop import joint_stop_s
from qrobot.motion.planning.path_stop import PathStop, joints_ahead, plan_cartesian_stop, plan_path_stop
from qrobot.motion.planning.planner import SegmentEntry
from qrobot.motion.planning.timing import Scheduler
from qrobot.motion.trajectory.planned_path import PathSample
from qrobot.motion.trajectory.speed_override import FULL_SPEED, SpeedOverride
from qrobot.motion.world.equation import Goal
from qrobot.motion.world.kinematics import ArmKinematics
from qrobot.motion.world.limits import MotionLimits

_LEAST_STEP: Final = 1e-4  # samples of path time, between places that tell a velocity and an acceleration


class Given(NamedTuple):
    """The newest setpoint given out: its sample, its path time, the rate of that with its change per sample, its piece.

    The piece is None on a path that is none of the joints.
    """

    tick: int
    clock: float
    rate: float
    slope: float
    piece: PathPiece | None


class TrajectoryState:
    """The motion of one arm as it stands at the newest sample.

    Args:
        q: setpoint to begin at, at rest. Shape (n,).
        tick: number of that sample.
        settings: of the pieces.
        limits: of the arm.

    Attributes:
        path: where the arm is to be, as a function of path time.
        tick: newest sample.
        clock: path time.
        override: how fast path time passes.
    """

    def __init__(self, q: Floats, tick: int, settings: BlendSettings, limits: MotionLimits) -> None:
        self.path = Path(q, settings)
        self.tick = tick
        self.clock = 0.0
        self.override = SpeedOverride(limits, settings.period_s)
        self._asked = FULL_SPEED
        self._settings = settings
        self._given = Given(tick, 0.0, 1.0, 0.0, self.path.piece)
        self._lags = deque([0.0], maxlen=DEPTH)  # of path time behind the newest samples, this one included
        self._path_stop: PathStop | None = None
        self._path_stop_tick = 0
        self._path_stop_least_s = 0.0
        self._setpoints = SetpointHistory(tick, q)
        self._actual = SetpointHistory(tick, q)  # the same, with joints that follow no setpoints where they are
        self._standing: Floats | None = None

    # ------------------------------------------------------------------------------------------------ what there is

    @property
    def _wanted(self) -> float:
        """The override; full speed with a goal that moves or complies, which knows no other."""
        return self._asked if self.path.coordinates.fixed else FULL_SPEED

    @property
    def newest(self) -> Floats:
        """The newest setpoint given out. Shape (n,)."""
        return self._setpoints.newest

    @property
    def on_joint_path(self) -> bool:
        """The joints move on straight lines of their own, or rest."""
        return self.path.coordinates is JOINTS

    @property
    def stopped(self) -> bool:
        """A stop that was begun is over."""
        if self._path_stop is not None:
            return self.tick - self._path_stop_tick >= self._path_stop.length
        return self.path.phase is Phase.JOINT_STOP and self.clock >= self.path.piece.end

    @property
    def at_full_speed(self) -> bool:
        """Path time passes as the clock does, and did so at the newest samples."""
        return self.override.full and len(set(self._lags)) <= 1

    @property
    def on_the_clock(self) -> bool:
        """Path time passes as the clock does, did so at the newest samples, and is whole at each of them."""
        return self.at_full_speed and all(lag.is_integer() for lag in self._lags)

    @property
    def paused(self) -> bool:
        """Path time stands still because that was asked for."""
        return self.override.rate == 0.0

    @property
    def rate(self) -> float:
        """Rate of path time at the newest sample: 1 for the speed as programmed, and in a stop of the joints."""
        return FULL_SPEED if self.path.phase is Phase.JOINT_STOP else self._rate_and_slope[0]

    @property
    def _rate_and_slope(self) -> tuple[float, float]:
        """Rate of path time at the newest sample, and its change per sample."""
        if self._path_stop is None:
            return self.override.rate, self.override.slope
        _, rate, slope = self._path_stop.at(self.tick - self._path_stop_tick)
        return rate, slope

    @property
    def _joint_piece(self) -> PathPiece | None:
        return self.path.piece if self.on_joint_path else None

    @property
    def held(self) -> bool:
        """True while no segment may begin: in a pause, also in one that has to follow a goal that moves."""
        return self.paused or (self._asked == 0.0 and not self.path.coordinates.fixed)

    def state(self) -> Floats:
        """Position, velocity and acceleration of the setpoints at the newest sample. Shape (3, n), SI units.

        Exact on joint paths; else of the parabola through the newest three setpoints.
        """
        if not self.on_joint_path:
            return self._setpoints.state(self._settings.period_s)
        if self._path_stop is None:
            return self.path.state(self.clock, self.override.rate, self.override.slope)
        return self.path.state(*self._path_stop.at(self.tick - self._path_stop_tick))

    def setpoint(self) -> Floats:
        """Joint positions of this sample. Shape (n,). Raises Unreachable, JointLimit or Singular."""
        return self.path.joints(self.clock)

    def goal_joints(self) -> Floats:
        """Joint positions (n,) at the end of the present segment, or where the arm rests. Raises as `setpoint`."""
        return self.path.goal_joints(self.newest)

    def end_of_stop(self) -> Floats:
        """Joint positions (n,) where the stop that is under way ends."""
        if self._path_stop is None:  # a joint stop is a piece of its own
            q: Floats = self.path.state(self.path.piece.end)[0]
            return q
        segment, (clock, *_) = self.path.segment, self._path_stop.at(self._path_stop.length)
        if segment is not None and clock >= segment.end + segment.schedule.resting:
            return segment.end_joints  # the motion ends before so long a stop
        *_, q = joints_ahead(self._path_stop, self.path, self.newest, self.tick - self._path_stop_tick)
        return q

    def points(self) -> History:
        """Positions of the arm at the newest samples, this one included; at another speed, by path time.

        At rest and in a pause all are where the arm is now: it may have moved still at those before. They are no fewer,
        because a goal that moves has a velocity against an arm that stands.
        """
        if not self.path.coordinates.fixed:
            return self._newest_points()
        rests = self.path.phase is Phase.RESTING and self._standing is None
        if rests or self.paused:
            newest = self._newest_points()
            return [(tick, newest[-1][1]) for tick, _ in newest]
        return self._newest_points() if self.override.full else self.points_at(self.clock)

    def points_at(self, clock: float) -> History:
        """Positions of the arm at path time `clock`, on the present piece, and a sample or less of it before."""
        step = min(1.0, 0.5 * (clock - self.path.piece.start))
        if not step > _LEAST_STEP:
            return self._newest_points()
        solve, moments = self.path.coordinates.solve_at, (clock - 2.0 * step, clock - step, clock)
        return [(moment, solve(self.path.state(moment)[0], self.newest)) for moment in moments]

    def _newest_points(self) -> History:
        return self._actual.with_now(self.tick, true_joints(self.setpoint(), self._standing))

    def given_points(self) -> History:
        """The newest positions that were given out, of joints that follow no setpoints where they were."""
        return self._actual.points

    def setpoints_with(self, q: Floats) -> History:
        """The newest setpoints, as if `q` (n,) were that of this sample."""
        return self._setpoints.with_now(self.tick, q)

    def sample(self, events: tuple[MotionEvent, ...]) -> PathSample:
        """Path that is followed from the newest sample on, in which `events` happened."""
        path_stop = None if self._path_stop is None else (self._path_stop, self._path_stop_tick)
        path = self.path
        return PathSample(self.tick, self.newest, self.clock, path.piece, path.coordinates, path_stop, events)

    # ------------------------------------------------------------------------------------------ once per sample

    def advance(self, tick: int, standing: Floats | None, asked: float = FULL_SPEED) -> None:
        """Time has come to sample `tick`; `standing` as in `Generator.update`, `asked` the override.

        Raises MotionError: it is not later than the sample before.
        """
        if tick <= self.tick:
            raise MotionError(f"sample {tick} asked for after sample {self.tick}")
        self._asked = asked
        wanted = self._wanted
        if self._path_stop is not None:
            self.clock = self._path_stop.at(tick - self._path_stop_tick)[0]
        elif self.path.phase in (Phase.JOINT_STOP, Phase.RESTING):
            self.override.jump(FULL_SPEED if self.path.phase is Phase.JOINT_STOP else wanted)
            self.clock += tick - self.tick
        else:
            self.clock += self.override.advance(tick - self.tick, wanted)
        self.tick = tick
        self._lags.append(tick - self.clock)
        self._standing = standing

    def give_out(self, q: Floats) -> None:
        """The setpoint (n,) of this sample is `q`."""
        self._setpoints.append(self.tick, q)
        self._actual.append(self.tick, true_joints(q, self._standing))
        self._given = Given(self.tick, self.clock, *self._rate_and_slope, self._joint_piece)

    # ------------------------------------------------------------------------------------------- other pieces

    def enter(self, entry: SegmentEntry, begin: float) -> None:
        """Turn into another segment, beginning at path time `begin`."""
        self._setpoints = self._actual.copy()
        self.path.enter(entry.segment, begin, entry.state)

    def hold(self, x: Floats) -> None:
        """Stand at `x` (m,), in the coordinates of the path."""
        if self.path.phase.stopping:
            self.override.jump(self._wanted)  # what waits may begin in this very sample, unless there is a pause
        self.path.hold(x, self.clock)
        self._path_stop = None
        self._lags.clear()  # what was before rest counts no more

    def rest_here(self) -> None:
        """Stand where a stop that is over has led to. Raises as `setpoint`."""
        q = self.setpoint()
        self.path.coordinates = JOINTS
        self.hold(q)

    def stand_exactly(self) -> None:
        """Stand in the joints' coordinates where the goal is that the arm has come to, unless that moves.

        Its newest setpoints may have moved still. Raises as `setpoint`.
        """
        if self.path.coordinates.fixed and not self.on_joint_path:
            self.path.rest_at(self.setpoint(), self.clock)

    def stand_still(self, tick: int) -> None:
        """The arm has stood at the newest setpoint since before sample `tick`, and path time with it."""
        self.override.jump(0.0)
        self._setpoints = SetpointHistory(tick, self.newest)
        self._actual = self._setpoints.copy()
        self.tick, self.clock, self._standing = tick, self._given.clock, None
        self._given = Given(tick, self.clock, 0.0, 0.0, self._joint_piece)
        self._lags.clear()

    def follow(self, goal: Goal, kinematics: ArmKinematics) -> None:
        """Stand at `goal`, where the newest setpoint is, and go where it goes."""
        q, tracker = self.newest, GoalTracker(goal)
        tracker.sample(self.tick)
        self.path.rest_on(DriveCoordinates(tracker, kinematics, kinematics.branch(q), q), self.clock)

    def approach_rest(self, segment: Segment) -> None:
        """Turn into the transition to rest; late, when a request that was to follow is gone."""
        self.path.end_segment(segment, max(segment.rest_begin, self._given.clock))

    def may_stop_sooner(self, seconds: float, scheduler: Scheduler) -> bool:
        """A stop on the path that was to take more than `seconds` is under way, and the joints can rest before its end.

        One that was asked to be as short as possible is so.
        """
        if self._path_stop is None or not seconds < self._path_stop_least_s:
            return False
        return max(seconds, self._shortest_stop_s(scheduler)) < self._left(self._path_stop) * scheduler.period_s

    def begin_path_stop(self, segment: Segment, seconds: float, scheduler: Scheduler) -> bool:
        """Begin to stop in at least `seconds` on the path of `segment`, the present one.

        A stop that is under way on it goes on where that is over as soon.

        False on a Cartesian path, which has to stand still, when the joints cannot: they have to leave it.
        """
        if not self.path.phase.ending and self.clock > segment.rest_begin:
            self.approach_rest(segment)
        path_stop = self._plan_path_stop(seconds, scheduler)
        if path_stop is None:
            return False
        self._path_stop_least_s = seconds
        if self._path_stop is None:
            self.path.begin_path_stop()
        elif path_stop.length >= self._left(self._path_stop):
            return True
        self._path_stop, self._path_stop_tick = path_stop, self.tick
        return True

    def _plan_path_stop(self, seconds: float, scheduler: Scheduler) -> PathStop | None:
        rate, slope = self._rate_and_slope
        if self.on_joint_path:
            return plan_path_stop(self.path, self.clock, seconds, scheduler, rate, slope)
        least_s = max(seconds, self._shortest_stop_s(scheduler))
        return plan_cartesian_stop(self.path, self.clock, least_s, self.newest, scheduler, rate, slope)

    def _left(self, path_stop: PathStop) -> float:
        """Samples until the stop that is under way on the path is over."""
        return path_stop.length - (self.tick - self._path_stop_tick)

    def _shortest_stop_s(self, scheduler: Scheduler) -> float:
        """Seconds in which the joints can come to rest from the newest setpoints, wherever that is."""
        return joint_stop_s(self._actual.state(scheduler.period_s), scheduler.limits, scheduler.blend)[0]

    def begin_joint_stop(self, limits: MotionLimits) -> None:
        """Begin to bring the joints to rest from the newest setpoint, as soon as they can, whatever the path was.

        Each setpoint was judged by where such a stop would end: a longer one would end beyond that. The piece of path
        that the setpoint lies on may have been left since; an arm that has come to rest since begins at rest.
        """
        period_s, given = self._settings.period_s, self._given
        piece = self._joint_piece if self.path.phase is Phase.RESTING else given.piece
        if piece is None:
            state = self._actual.state(period_s)
        else:
            state = piece.state(given.clock, self._settings, given.rate, given.slope / period_s)
        length_s, fading_s = joint_stop_s(state, limits, self._settings.blend)
        self._path_stop = None
        self._setpoints = self._actual.copy()
        self.path.begin_joint_stop(state, given.clock, length_s / period_s, fading_s / length_s)
        self.clock = given.clock + (self.tick - given.tick)  # a stop of the joints knows no other speed
