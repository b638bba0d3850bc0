"""How many samples a segment and its transitions take.

A segment of T samples between two corners begins with a transition whose second half (Ta) lies in it and ends with one
whose first half does, so T >= Ta + the next Ta; T is stretched until that holds (Paul asks for T >= 2 Ta). A transition
over a change of velocity dv needs 2 Ta >= PEAK |dv| / a_max.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from qrobot.motion.blend import PEAK, Blend
from qrobot.motion.limits import Floats, MotionLimits
from qrobot.motion.request import MoveRequest, enough_samples, whole_samples

DEFAULT_TRANSITION_S: Final = 0.2  # the transition time of the crank example, Hayward & Paul 1986


MANY: Final = 1 << 30  # samples; more than any transition takes


@dataclass(frozen=True)
class Schedule:
    """Times of one segment, in samples.

    Attributes:
        transition: Ta of the transition into the segment.
        length: T, from the corner it leaves to the corner it reaches.
        braking: least Ta of a transition out of it to rest.
        resting: Ta of that transition when nothing follows.
    """

    transition: int
    length: int
    braking: int
    resting: int


@dataclass(frozen=True, eq=False)
class Scheduler:
    """Turns requests into schedules for one arm and sample period.

    Attributes:
        limits: of the arm.
        period_s: sample period.
        blend: polynomial of the transitions.
    """

    limits: MotionLimits
    period_s: float
    blend: Blend

    def check(self, request: MoveRequest, start: Floats) -> None:
        """Judge a request that begins and ends at rest; `start` has shape (n,).

        Raises:
            JointLimit: the target is outside the joints' range.
            MotionError: the time, the speed or the transition asks for more than the arm can do.
        """
        what = f"move to {request.name}"
        self.limits.check_position(request.target, what)
        distance = request.target - start
        ta = self.preferred(request)
        least = enough_samples(float((np.abs(distance) / self.limits.v_max).max()), self.period_s)
        length = max(self._asked(request, distance), 2 * ta)
        v = distance / (length * self.period_s)
        self.limits.check_velocity(v, what, f"give it {self._ms(least)} or more")
        if request.transition_s is not None:
            a = PEAK[self.blend] * v / (2 * ta * self.period_s)
            needed = self._ms(self.needed(v))
            self.limits.check_acceleration(a, what, f"give the transition {needed} or more")

    def plan(
        self, request: MoveRequest, distance: Floats, v0: Floats, least: int = 1, most: int = MANY, following: int = 0
    ) -> Schedule:
        """A schedule that keeps the limits, stretching times where needed.

        Args:
            request: what was asked.
            distance: from the corner the segment leaves to its target. Shape (n,).
            v0: velocity before the transition. Shape (n,).
            least, most: wanted bounds of the transition, in samples; longer than `most` only when the arm needs it.
            following: Ta of the request behind it in the queue, 0 when there is none.
        """
        slowest = enough_samples(float((np.abs(distance) / self.limits.v_max).max()), self.period_s)
        asked = max(self._asked(request, distance), slowest)
        resting = self.preferred(request)
        transition = max(min(resting, most), least)
        while True:  # both transitions only grow, and what they need is bounded by the speed asked for
            length = max(asked, transition + max(resting, following))
            v1 = distance / (length * self.period_s)
            entering, braking = self.needed(v1 - v0), self.needed(v1)
            if entering <= transition and braking <= resting:
                return Schedule(transition, length, braking, resting)
            transition, resting = max(transition, entering), max(resting, braking)

    def preferred(self, request: MoveRequest) -> int:
        """Ta as asked for, in samples."""
        seconds = DEFAULT_TRANSITION_S if request.transition_s is None else request.transition_s
        return whole_samples(seconds, self.period_s)

    def needed(self, dv: Floats) -> int:
        """Least Ta, in samples, over a change of velocity `dv`. Shape (n,)."""
        seconds = float((np.abs(dv) / self.limits.a_planned).max()) * PEAK[self.blend] / 2.0
        return enough_samples(seconds, self.period_s)

    def _asked(self, request: MoveRequest, distance: Floats) -> int:
        return request.pace.samples(distance, self.limits, self.period_s)

    def _ms(self, samples: int) -> str:
        return f"{1000.0 * samples * self.period_s:.0f} ms"
