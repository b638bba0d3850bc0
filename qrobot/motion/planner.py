"""From a queued request and the state of the arm to the segment that serves it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.motion.coordinates import JOINTS, measured
from qrobot.motion.geometric_path import GeometricPath, plan_geometric_path
from qrobot.motion.joint_stop import all_haltable
from qrobot.motion.kinematics import Reach
from qrobot.motion.limits import MotionLimits
from qrobot.motion.path import Segment, segment_of
from qrobot.motion.path_piece import BlendSettings, PathPiece, piece_from_state, piece_joining_line
from qrobot.motion.queued_motion import NOTHING, Following, QueuedMotion, prepare_motion
from qrobot.motion.replan import divert
from qrobot.motion.request import MoveRequest
from qrobot.motion.setpoint_history import History, motion_of
from qrobot.motion.timing import MANY, Schedule, Scheduler

_LOOKS: Final = 16
_EARLY: Final = np.linspace(0.0, 1.0, _LOOKS + 1)[1:] ** 2  # most of them where what was left over fades out
_TRIES: Final = 12
_LONGER: Final = 1.3


@dataclass(frozen=True, eq=False)
class SegmentEntry:
    """How a segment is entered.

    Attributes:
        segment: to be served.
        state: of the arm at its start, in the segment's coordinates. Shape (3, m).
    """

    segment: Segment
    state: Floats


@dataclass(frozen=True)
class TransitionBounds:
    """Bounds of a transition.

    Attributes:
        least, most: samples; the second is a wish.
        following: what the request behind asks for.
        at_any_rate: from rest there is no other way; its setpoints are judged one by one.
    """

    least: int = 1
    most: int = MANY
    following: Following = NOTHING
    at_any_rate: bool = False


class Planner:
    """Plans for one arm.

    Args:
        limits: of the arm.
        shape: of the legs.
        reach: kinematics, None when they are not known.

    Attributes:
        scheduler: of times.
    """

    def __init__(self, limits: MotionLimits, shape: BlendSettings, reach: Reach | None) -> None:
        self.scheduler = Scheduler(limits, shape.period_s, shape.blend)
        self._limits = limits
        self._shape = shape
        self._reach = reach

    def prepare(self, request: MoveRequest, start: Floats | None, near: Floats, tick: int) -> QueuedMotion:
        """Judge a request as a motion from rest at `start` (n,) to rest, as far as both are known.

        Args:
            request: what was asked.
            start: where the arm will be before it; None when that moves.
            near: where it is now. Shape (n,).
            tick: newest sample.

        Raises:
            JointLimit, Unreachable, Singular: the goal, or the way there, is not for this arm.
            MotionError: the arm cannot do it in that time.
        """
        what = f"move to {request.name}"
        with _told(what):
            errand = prepare_motion(request, near if start is None else start, self._reach, tick)
        if errand.end is not None:
            self._limits.check_position(errand.end, what)
        if errand.here:
            return errand
        if errand.end is None or start is None:
            return replace(errand, asks=Following(self.scheduler.preferred(request)))
        with _told(what):
            course = self.lay(errand, start)
        self.scheduler.check(request, course)
        return replace(errand, asks=self.scheduler.alone(request, course))

    def lay(self, errand: QueuedMotion, corner: Floats) -> GeometricPath:
        """The way from the joint positions `corner` (n,); raises what `plan_geometric_path` raises."""
        return plan_geometric_path(errand, corner, self._reach)

    def depart(
        self, errand: QueuedMotion, corner: Floats, points: History, clock: float, room: TransitionBounds
    ) -> SegmentEntry | None:
        """Into `errand` now, at path time `clock`; None when no transition that was tried keeps the limits.

        Args:
            errand: what comes next.
            corner: joint positions from which its straight way leads. Shape (n,).
            points: the newest setpoints, that of now included.
            clock: path time.
            room: for the transition.

        Raises:
            MotionError: see `plan_geometric_path`.
        """
        course = self.lay(errand, corner)
        state, v = self._measured(course, points), motion_of(points, self._shape.period_s)[1]
        least, rest, segment = room.least, 1, None
        for _ in range(_TRIES):
            schedule = self.scheduler.plan(errand.request, course, v, least, room.most, room.following, rest)
            segment = self.segment(errand, course, schedule, clock + schedule.transition)
            if self._fits(segment, state, clock, points[-1][1]):
                return SegmentEntry(segment, state)
            least = rest = int(_LONGER * max(schedule.transition, schedule.resting)) + 1
        return SegmentEntry(segment, state) if room.at_any_rate and segment is not None else None

    def divert(self, errand: QueuedMotion, state: Floats, clock: float, following: Following) -> SegmentEntry | None:
        """Out of a joint path, at `state` (3, n), into the joint path of `errand`; None when no such way is safe."""
        lay = partial(self.lay, errand)
        segment = divert(errand.request, lay, state, clock, self.scheduler, self._shape, following)
        return None if segment is None else SegmentEntry(segment, state)

    def ahead(self, request: MoveRequest, points: History) -> Floats:
        """Where the joints will be, at their present speed, half a transition later: the corner of a diversion.

        Shape (n,).
        """
        q, v, _ = motion_of(points, self._shape.period_s)
        ahead = q + v * (self.scheduler.preferred(request) * self._shape.period_s)
        inside: Floats = np.clip(ahead, self._limits.q_min, self._limits.q_max)
        return inside

    def segment(self, errand: QueuedMotion, course: GeometricPath, schedule: Schedule, begin: float) -> Segment:
        """The segment that leaves its corner at path time `begin`."""
        return segment_of(errand.request, course, schedule, begin, self._shape.period_s)

    def _measured(self, course: GeometricPath, points: History) -> Floats:
        return measured(course.chart, points, self._shape.period_s)

    def _fits(self, segment: Segment, state: Floats, clock: float, near: Floats) -> bool:
        """True when the joints keep their limits in the transitions; not to be known when the goal moves."""
        if not segment.chart.fixed:
            return True
        entering = piece_joining_line(
            state, segment.corner, segment.begin, segment.velocity, clock, 2.0 * segment.schedule.transition,
            self._shape.period_s,
        )  # fmt: skip
        if segment.chart is JOINTS:  # whose end is planned within the limits
            looks = entering.start + entering.length * _EARLY
            states = np.array([entering.state(look, self._shape) for look in looks])
            return all_haltable(states[:, 1], states[:, 2], self._limits)
        legs = (entering, to_rest(segment, self._shape))
        try:
            return all(self._keeps_limits(segment, leg, near) for leg in legs)
        except MotionError:  # the turn leads where the straight lines do not
            return False

    def _keeps_limits(self, segment: Segment, leg: PathPiece, near: Floats) -> bool:
        step_s = leg.length * self._shape.period_s / _LOOKS
        joints = np.empty((_LOOKS + 1, near.size))
        for i, look in enumerate(np.linspace(leg.start, leg.end, _LOOKS + 1)):
            joints[i] = near = segment.chart.look(leg.state(look, self._shape)[0], near)
        v = np.array(np.gradient(joints, step_s, axis=0, edge_order=2))
        a = np.diff(joints, 2, axis=0)[[0, *range(_LOOKS - 1), -1]] / step_s**2
        return all_haltable(v, a, self._limits)


@contextmanager
def _told(what: str) -> Iterator[None]:
    """Say with every refusal what was asked."""
    try:
        yield
    except MotionError as error:
        raise type(error)(f"{what}: {error}") from error


def to_rest(segment: Segment, shape: BlendSettings) -> PathPiece:
    """The transition to rest at the end of a segment."""
    length = 2.0 * segment.schedule.resting
    behind = segment.velocity * (segment.schedule.resting * shape.period_s)
    state = np.vstack((segment.target - behind, segment.velocity, np.zeros_like(behind)))
    return piece_from_state(state, np.zeros_like(behind), segment.rest_begin, length)
