"""The path of one arm, leg by leg: the segment being followed, and how it is entered and left.

Path time is counted in samples. Every leg begins exactly where, and as fast as, the one before it is at that instant.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.motion.blend import Blend, beta
from qrobot.motion.coordinates import JOINTS, Coordinates
from qrobot.motion.geometric_path import GeometricPath
from qrobot.motion.path_piece import BlendSettings, PathPiece, piece_from_state, piece_joining_line, rest
from qrobot.motion.request import MoveRequest
from qrobot.motion.timing import Schedule

_NOWHERE: Final = 1e-9  # rad or m; rounding


@dataclass(frozen=True, eq=False)
class Segment:
    """A request being served, in the coordinates (m,) of its chart.

    Attributes:
        request: what was asked.
        chart: its coordinates.
        begin: path time of the corner it left.
        corner: that corner. Shape (m,).
        target: the corner it goes to. Shape (m,).
        schedule: its times.
        velocity: on its straight part. Shape (m,).
        arriving: joint velocity at its far end, before any transition. Shape (n,).
    """

    request: MoveRequest
    chart: Coordinates
    begin: float
    corner: Floats
    target: Floats
    schedule: Schedule
    velocity: Floats
    arriving: Floats

    @property
    def end(self) -> float:
        """Path time at which the target would be reached without a transition."""
        return self.begin + self.schedule.length

    @property
    def dwells(self) -> bool:
        """It stays where it is for a time that was asked for, so that there is nothing to come to rest from.

        Not with a frame that moves: the frame may be a function of `scal`, which comes to rest as the motion does.
        """
        still = bool(np.abs(self.target - self.corner).max() <= _NOWHERE)
        return still and self.chart.fixed and self.request.transition_s is not None

    @property
    def rest_begin(self) -> float:
        """Path time at which the transition to rest begins when nothing follows."""
        return self.end - self.schedule.resting

    def scal(self, clock: float, blend: Blend, ending: bool) -> float:
        """How much of the segment is done, 0 to 1: the s of a way from rest, smooth where the motion is.

        Args:
            clock: path time.
            blend: polynomial of the transitions.
            ending: the transition to rest has begun.
        """
        length = self.schedule.length
        if ending and not self.dwells:
            d = 2.0 * self.schedule.resting
            h = min((clock - self.rest_begin) / d, 1.0)
            return 1.0 + (d * (h - 0.5 - beta(int(blend), h)[0])) / length
        d = 2.0 * self.schedule.transition
        h = max((clock - self.begin) / d + 0.5, 0.0)
        return min(d * beta(int(blend), h)[0] / length, 1.0)


def segment_of(
    request: MoveRequest, course: GeometricPath, schedule: Schedule, begin: float, period_s: float
) -> Segment:
    """The segment that leaves its corner at path time `begin`."""
    seconds = schedule.length * period_s
    velocity, arriving = course.velocity(seconds), course.arriving(seconds)
    return Segment(request, course.chart, begin, course.corner, course.target, schedule, velocity, arriving)


class Path:
    """Where the arm is to be, as a function of path time.

    Args:
        q: where it stands at path time 0. Shape (n,).
        shape: of the legs.

    Attributes:
        chart: coordinates of the present leg.
        leg: the piece being followed.
        segment: the request being served, None at rest.
        ending: the leg is the transition to rest at the segment's target.
        shape: of the legs.
    """

    def __init__(self, q: Floats, shape: BlendSettings) -> None:
        self.chart: Coordinates = JOINTS
        self.leg = rest(np.array(q, dtype=np.float64), 0.0)
        self.segment: Segment | None = None
        self.ending = False
        self.shape = shape

    def state(self, clock: float, rate: float = 1.0, slope: float = 0.0) -> Floats:
        """Coordinates, velocity and acceleration; shape (3, m), SI units.

        Path time passes at `rate` (1: as fast as time), which changes by `slope` per sample.
        """
        return self.leg.state(clock, self.shape, rate, slope / self.shape.period_s)

    def joints(self, clock: float) -> Floats:
        """Joint positions (n,) at the newest sample. Raises Unreachable, JointLimit or Singular."""
        return self.chart.joints(self.state(clock)[0])

    def goal_joints(self, near: Floats) -> Floats:
        """Joint positions (n,) at the end of the present segment, or where the arm rests. Raises as `joints`."""
        goal = self.leg.rows[0] if self.segment is None else self.segment.target
        return self.chart.look(goal, near)

    def hold(self, x: Floats, clock: float) -> None:
        """Stand at `x` (m,): still, or with the goal when the goal moves."""
        self.leg, self.segment, self.ending = rest(x, clock), None, False

    def enter(self, segment: Segment, begin: float, state: Floats) -> None:
        """Turn into `segment`, beginning at path time `begin` with `state` (3, m) in the segment's coordinates."""
        self.leg = piece_joining_line(
            state, segment.corner, segment.begin, segment.velocity, begin, 2.0 * segment.schedule.transition,
            self.shape.period_s,
        )  # fmt: skip
        self.chart, self.segment, self.ending = segment.chart, segment, False

    def end_segment(self, segment: Segment, begin: float) -> None:
        """Turn into the transition to rest at the target of `segment`, the present one."""
        self.leg, self.ending = self._leg_to_rest(segment, begin), True

    def halt(self, state: Floats, clock: float, length: float, fading: Floats) -> None:
        """Bring the joints to rest from `state` (3, n) within `length` samples, wherever that is.

        Their accelerations fade out in the shares `fading` (n,) of that.
        """
        self.chart, self.ending = JOINTS, True
        self.leg = piece_from_state(state, np.zeros_like(state[1]), clock, length, fading)

    def states_ahead(self, moments: Iterator[tuple[float, float, float]]) -> Iterator[Floats]:
        """States (3, m) at future (path time, rate, slope per sample), if nothing follows the present segment."""
        final, final_from = self.leg, float("inf")
        if self.segment is not None and not self.ending:
            final_from = self.segment.rest_begin
            final = self._leg_to_rest(self.segment, final_from)
        for clock, rate, slope in moments:
            leg = final if clock >= final_from else self.leg
            yield leg.state(clock, self.shape, rate, slope / self.shape.period_s)

    def _leg_to_rest(self, segment: Segment, begin: float) -> PathPiece:
        length = (1.0 if segment.dwells else 2.0) * (segment.end - begin)
        return piece_from_state(self.state(begin), np.zeros_like(segment.velocity), begin, length)
