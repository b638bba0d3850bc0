"""Planner of the segment that serves a queued request, from the state of the arm."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import FenceCrossed, MotionError
from qrobot.motion.event import Termination
from qrobot.motion.path.coordinates import JOINTS, measured
from qrobot.motion.path.path_piece import BlendSettings, PathPiece, piece_from_state, piece_joining_line
from qrobot.motion.path.segment import Schedule, Segment
from qrobot.motion.path.setpoint_history import History, motion_of
from qrobot.motion.planning.fence_check import WHAT, FenceCheck
from qrobot.motion.planning.geometric_path import GeometricPath, joint_geometry, plan_geometric_path, segment_of
from qrobot.motion.planning.joint_stop import all_can_stop, all_can_stop_along
from qrobot.motion.planning.queued_motion import NO_FOLLOWER, Following, QueuedMotion, prepare_motion
from qrobot.motion.planning.replan import replan
from qrobot.motion.planning.setpoint_check import judge_row
from qrobot.motion.planning.timing import MANY, Scheduler
from qrobot.motion.request import MoveRequest, enough_samples
from qrobot.motion.world.kinematics import ArmKinematics
from qrobot.motion.world.limits import MotionLimits

_PROBES: Final = 16
_MOST_PROBES: Final = 128  # [A] each takes some 15 us
_EARLY: Final = np.linspace(0.0, 1.0, _PROBES + 1)[1:] ** 2  # most of them where what was left over fades out
_TRIES: Final = 12
_LONGER: Final = 1.3
_SAME: Final = 1e-6  # [A] rad or m; a way that begins so near the one that was looked at is that way


@dataclass(frozen=True, eq=False)
class SegmentEntry:
    """Entry into a segment.

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
    following: Following = NO_FOLLOWER
    at_any_rate: bool = False


class Planner:
    """Plans for one arm.

    Args:
        limits: of the arm.
        settings: of the pieces.
        kinematics: kinematics, None when they are not known.
        fences: judge of ways by fences, None for an arm without.

    Attributes:
        scheduler: of times.
    """

    def __init__(
        self,
        limits: MotionLimits,
        settings: BlendSettings,
        kinematics: ArmKinematics | None,
        fences: FenceCheck | None = None,
    ) -> None:
        self.scheduler = Scheduler(limits, settings.period_s, settings.blend)
        self._limits = limits
        self._settings = settings
        self._kinematics = kinematics
        self._fences = fences

    def prepare(self, request: MoveRequest, start: Floats | None, near: Floats, tick: int) -> QueuedMotion:
        """Judge a request as a motion from rest at `start` (n,) to rest, as far as both are known.

        Args:
            request: what was asked.
            start: where the arm will be before it; None when that moves.
            near: where it is now. Shape (n,).
            tick: newest sample.

        Raises:
            JointLimit, Unreachable, Singular: the goal, or the way there, is not for this arm.
            FenceCrossed: the way leads too near a fence.
            MotionError: the arm cannot do it in that time.
        """
        what = f"move to {request.name}"
        with _naming(what):
            queued = prepare_motion(request, near if start is None else start, self._kinematics, tick)
        if queued.end is not None:
            self._limits.check_position(queued.end, what, near if start is None else start)
        if queued.here:
            enough_samples(request.stay_s, self._settings.period_s)  # which refuses what cannot be counted
            return queued
        if queued.end is None or start is None:
            return replace(queued, asks=Following(self.scheduler.preferred(request)))
        with _naming(what):
            geometry = self.plan_geometry(queued, start)
        self.scheduler.check(request, geometry)
        if self._fences is not None and queued.fixed:
            self._fences.check_way(geometry, start, what)
        asks = self.scheduler.alone(request, geometry)
        return replace(queued, end=geometry.end_joints, asks=asks, start=start)

    def plan_geometry(self, queued: QueuedMotion, via: Floats, arm: Floats | None = None) -> GeometricPath:
        """The way from the joint positions `via` (n,), entered at `arm` (n,); see `plan_geometric_path`."""
        return plan_geometric_path(queued, via, self._kinematics, self._limits, arm)

    def plan_entry(
        self, queued: QueuedMotion, via: Floats, points: History, clock: float, bounds: TransitionBounds
    ) -> SegmentEntry | None:
        """Plan the entry into `queued` now, at path time `clock`; None when no transition that was tried keeps the
        limits.

        Args:
            queued: what comes next.
            via: joint positions from which its straight way leads. Shape (n,).
            points: the newest setpoints, that of now included.
            clock: path time.
            bounds: for the transition.

        Raises:
            FenceCrossed: from rest, the way leads too near a fence.
            MotionError: see `plan_geometric_path`.
        """
        geometry = self.plan_geometry(queued, via, points[-1][1])
        state, v = self._measured(geometry, points), motion_of(points, self._settings.period_s)[1]
        least, rest, entry = bounds.least, 1, None
        for _ in range(_TRIES):
            schedule = self.scheduler.plan(queued.request, geometry, v, least, bounds.most, bounds.following, rest)
            entry = SegmentEntry(self.segment(queued, geometry, schedule, clock + schedule.transition), state)
            if self._fits(entry.segment, state, clock, points[-1][1]):
                if bounds.at_any_rate:
                    break
                return entry if self.is_clear(entry, clock, points[-1][1]) else None
            least = rest = int(_LONGER * max(schedule.transition, schedule.resting)) + 1
        if not bounds.at_any_rate or entry is None:
            return None
        self._check_from_rest(queued, entry, clock, via, points[-1][1])
        return entry

    def _check_from_rest(self, queued: QueuedMotion, entry: SegmentEntry, begin: float, via: Floats, q: Floats) -> None:
        """Raise FenceCrossed when the way from rest at `q` (n,) is too near a fence, if it begins elsewhere than the
        way that was looked at when it was asked for."""
        if queued.start is None or max(np.abs(via - queued.start).max(), np.abs(q - queued.start).max()) > _SAME:
            self._check_fences(entry, begin, q, f"move to {queued.request.name}")

    def replan(self, queued: QueuedMotion, state: Floats, clock: float, following: Following) -> SegmentEntry | None:
        """Plan the way out of a joint path, at `state` (3, n), into that of `queued`; None when no such way is safe."""
        plan_geometry = partial(self.plan_geometry, queued)
        segment = replan(queued.request, plan_geometry, state, clock, self.scheduler, self._settings, following)
        entry = None if segment is None else SegmentEntry(segment, state)
        return entry if entry is not None and self.is_clear(entry, clock, state[0]) else None

    def is_clear(self, entry: SegmentEntry, begin: float, near: Floats) -> bool:
        """True when the arm, about at `near` (n,), keeps off its fences on this way, entered at path time `begin`.

        Always so without fences, and where the goal moves: its setpoints are judged one by one.
        """
        try:
            self._check_fences(entry, begin, near, WHAT)
        except MotionError:  # also when the turn leads where the straight lines do not
            return False
        return True

    def _check_fences(self, entry: SegmentEntry, begin: float, near: Floats, what: str) -> None:
        """Raise FenceCrossed where `is_clear` is False, and what the coordinates raise."""
        segment = entry.segment
        if self._fences is None or not segment.coordinates.fixed:
            return
        piece = piece_joining_line(
            entry.state, segment.via, segment.begin, segment.velocity, begin, 2.0 * segment.schedule.transition,
            self._settings.period_s,
        )  # fmt: skip
        self._fences.check_entry(segment, piece, self._settings, near, what)

    def joint_stop_is_clear(self, points: History) -> bool:
        """True when a stop of the joints from the newest of some setpoints keeps off the fences."""
        if self._fences is None:
            return True
        try:
            self._fences.judge_stop(points, self._settings.period_s, self._limits, self._settings.blend)
        except FenceCrossed:
            return False
        return True

    def ahead(self, request: MoveRequest, points: History) -> Floats:
        """Joints half a transition later, at their present speed: the via point of a replanned path.

        Shape (n,).
        """
        q, v, _ = motion_of(points, self._settings.period_s)
        ahead = q + v * (self.scheduler.preferred(request) * self._settings.period_s)
        inside: Floats = np.clip(ahead, self._limits.q_min, self._limits.q_max)
        return inside

    def stay(self, request: MoveRequest, q: Floats, clock: float) -> SegmentEntry:
        """The time for which `request`, an absolute stop, has the arm stand at `q` (n,), from path time `clock` on."""
        ways = Schedule(1, enough_samples(request.stay_s, self._settings.period_s) + 1, 1, 1)
        segment = self.segment(QueuedMotion(request, target=q), joint_geometry(q, q), ways, clock + 1.0)
        return SegmentEntry(segment, np.vstack((q, np.zeros_like(q), np.zeros_like(q))))

    def segment(self, queued: QueuedMotion, geometry: GeometricPath, schedule: Schedule, begin: float) -> Segment:
        """The segment that leaves its via point at path time `begin`."""
        return segment_of(queued.request, geometry, schedule, begin, self._settings.period_s)

    def _measured(self, geometry: GeometricPath, points: History) -> Floats:
        return measured(geometry.coordinates, points, geometry.via, self._settings.period_s)

    def _fits(self, segment: Segment, state: Floats, clock: float, near: Floats) -> bool:
        """True when the joints, now at `near` (n,), keep their limits in the transitions; not to be known when the goal
        moves."""
        if not segment.coordinates.fixed:
            return True
        entering = piece_joining_line(
            state, segment.via, segment.begin, segment.velocity, clock, 2.0 * segment.schedule.transition,
            self._settings.period_s,
        )  # fmt: skip
        if segment.coordinates is JOINTS:  # whose end is planned within the limits, and is inside the range
            probes = entering.start + entering.length * _EARLY
            states = np.array([entering.state(probe, self._settings) for probe in probes])
            inside = self._limits.contain(states[:, 0], near)
            return inside and all_can_stop(states[:, 1], states[:, 2], self._limits)
        pieces = ((entering, near), (to_rest(segment, self._settings), segment.end_joints))
        try:
            return all(self._keeps_limits(segment, piece, beside) for piece, beside in pieces)
        except MotionError:  # the turn leads where the straight lines do not
            return False

    def _keeps_limits(self, segment: Segment, piece: PathPiece, near: Floats) -> bool:
        """True when a look at a few places finds nothing, and one at each sample neither, as its setpoints are judged.

        A few places show less than the peaks between them: at full speed the arm would enter, and be stopped half way.
        """
        joints, step_s = self._along(segment, piece, near, _PROBES)
        if not all_can_stop_along(joints, step_s, self._limits):
            return False
        joints, step_s = self._along(segment, piece, near, min(math.ceil(piece.length), _MOST_PROBES))
        return judge_row(joints, step_s, self._limits, self._settings.blend) is Termination.NONE

    def _along(self, segment: Segment, piece: PathPiece, near: Floats, steps: int) -> tuple[Floats, float]:
        """Joint positions (steps + 1, n) along a piece that begins at `near` (n,), and the time between two of them."""
        joints = np.empty((steps + 1, near.size))
        for i, probe in enumerate(np.linspace(piece.start, piece.end, steps + 1)):
            joints[i] = near = segment.coordinates.solve_at(piece.state(probe, self._settings)[0], near)
        return joints, piece.length * self._settings.period_s / steps


@contextmanager
def _naming(what: str) -> Iterator[None]:
    """Say with every refusal what was asked."""
    try:
        yield
    except MotionError as error:
        raise type(error)(f"{what}: {error}") from error


def to_rest(segment: Segment, settings: BlendSettings) -> PathPiece:
    """The transition to rest at the end of a segment."""
    length = 2.0 * segment.schedule.resting
    behind = segment.velocity * (segment.schedule.resting * settings.period_s)
    state = np.vstack((segment.target - behind, segment.velocity, np.zeros_like(behind)))
    return piece_from_state(state, np.zeros_like(behind), segment.rest_begin, length)
