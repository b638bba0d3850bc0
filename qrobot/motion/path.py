"""The path of one arm, leg by leg: the segment being followed, and how it is entered and left.

Path time is counted in samples. Every leg begins exactly where, and as fast as, the one before it is at that instant.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from qrobot.motion.blend import Blend
from qrobot.motion.leg import Leg, leg_from, rest
from qrobot.motion.limits import Floats
from qrobot.motion.request import MoveRequest
from qrobot.motion.schedule import Schedule


@dataclass(frozen=True, eq=False)
class Segment:
    """A request being served.

    Attributes:
        request: what was asked.
        corner: path time of the corner it left.
        schedule: its times.
        velocity: on its straight part. Shape (n,).
    """

    request: MoveRequest
    corner: float
    schedule: Schedule
    velocity: Floats

    @property
    def end(self) -> float:
        """Path time at which the target would be reached without a transition."""
        return self.corner + self.schedule.length

    @property
    def rest_begin(self) -> float:
        """Path time at which the transition to rest begins when nothing follows."""
        return self.end - self.schedule.resting

    def scal(self, clock: float) -> float:
        """How much of the segment is done, 0 to 1."""
        return min(max((clock - self.corner) / self.schedule.length, 0.0), 1.0)


class Path:
    """Where the arm is to be, as a function of path time.

    Args:
        q: where it stands at path time 0. Shape (n,).
        period_s: sample period.
        blend: polynomial of the transitions.

    Attributes:
        leg: the piece being followed.
        segment: the request being served, None at rest.
        ending: the leg is the transition to rest at the segment's target.
    """

    def __init__(self, q: Floats, period_s: float, blend: Blend) -> None:
        self.leg = rest(np.array(q, dtype=np.float64), 0.0)
        self.segment: Segment | None = None
        self.ending = False
        self._period_s = period_s
        self._blend = blend

    def state(self, clock: float, rate: float = 1.0, slope: float = 0.0) -> Floats:
        """Position, velocity and acceleration; shape (3, n), SI units.

        Path time passes at `rate` (1: as fast as time), which changes by `slope` per sample.
        """
        return self._state(self.leg, clock, rate, slope)

    def hold(self, q: Floats, clock: float) -> None:
        """Stand at `q` (n,)."""
        self.leg, self.segment, self.ending = rest(q, clock), None, False

    def enter(self, segment: Segment, begin: float) -> None:
        """Turn into `segment`, beginning at path time `begin`."""
        self.leg = leg_from(self.state(begin), segment.velocity, begin, 2.0 * segment.schedule.transition)
        self.segment, self.ending = segment, False

    def end_segment(self, segment: Segment, begin: float) -> None:
        """Turn into the transition to rest at the target of `segment`, the present one."""
        self.leg, self.ending = self._leg_to_rest(segment, begin), True

    def velocity_on(self, schedule: Schedule, distance: Floats) -> Floats:
        """Velocity of the straight part over `distance` (n,)."""
        return distance / (schedule.length * self._period_s)

    def states_ahead(self, moments: Iterator[tuple[float, float, float]]) -> Iterator[Floats]:
        """States (3, n) at future (path time, rate, slope per sample), if nothing follows the present segment."""
        final, final_from = self.leg, float("inf")
        if self.segment is not None and not self.ending:
            final_from = self.segment.rest_begin
            final = self._leg_to_rest(self.segment, final_from)
        for clock, rate, slope in moments:
            yield self._state(final if clock >= final_from else self.leg, clock, rate, slope)

    def _leg_to_rest(self, segment: Segment, begin: float) -> Leg:
        return leg_from(self.state(begin), np.zeros_like(segment.velocity), begin, 2.0 * (segment.end - begin))

    def _state(self, leg: Leg, clock: float, rate: float, slope: float) -> Floats:
        state = np.empty((3, leg.rows.shape[1]))
        leg.state(clock, self._period_s, self._blend, rate, slope / self._period_s, state)
        return state
