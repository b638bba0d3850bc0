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
from qrobot.motion.course import Course
from qrobot.motion.errand import NOTHING, Following
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

    def check(self, request: MoveRequest, course: Course) -> None:
        """Judge a request that begins and ends at rest.

        Raises:
            JointLimit: the target is outside the joints' range.
            MotionError: the time, the speed or the transition asks for more than the arm can do.
        """
        what = f"move to {request.name}"
        ta = self.preferred(request)
        length = max(self._asked(request, course), 2 * ta)
        v = np.abs(course.rates).max(axis=0) / (length * self.period_s)
        a = np.abs(course.bends).max(axis=0) / (length * self.period_s) ** 2
        remedy = f"give it {self._ms(self._least(course))} or more"
        self.limits.check_velocity(v, what, remedy)
        self.limits.check_acceleration(a, what, remedy)
        if request.transition_s is not None:
            entering = PEAK[self.blend] * v / (2 * ta * self.period_s)
            needed = self._ms(self.needed(v))
            self.limits.check_acceleration(entering, what, f"give the transition {needed} or more")

    def plan(
        self,
        request: MoveRequest,
        course: Course,
        v0: Floats,
        least: int = 1,
        most: int = MANY,
        following: Following = NOTHING,
    ) -> Schedule:
        """A schedule that keeps the limits, stretching times where needed.

        Args:
            request: what was asked.
            course: the way from corner to corner.
            v0: joint velocity before the transition. Shape (n,).
            least, most: wanted bounds of the transition, in samples; longer than `most` only when the arm needs it.
            following: what the request behind it asks for, when there is one.
        """
        asked = max(self._asked(request, course), self._least(course))
        resting, turning = self.preferred(request), following.transition
        transition = max(min(resting, most), least)
        while True:  # all transitions only grow, and what they need is bounded by the speed asked for
            length = max(asked, transition + max(resting, turning))
            seconds = length * self.period_s
            entering, braking = self.needed(course.leaving(seconds) - v0), self.needed(course.arriving(seconds))
            turn = self._turning(course.arriving(seconds), following)
            if entering <= transition and braking <= resting and turn <= turning:
                return Schedule(transition, length, braking, resting)
            transition, resting, turning = max(transition, entering), max(resting, braking), max(turning, turn)

    def _turning(self, arriving: Floats, following: Following) -> int:
        """Least Ta, in samples, of the transition into what follows."""
        return 0 if following.leaving is None else self.needed(following.leaving - arriving)

    def alone(self, request: MoveRequest, course: Course) -> Following:
        """What a request asks of the one before it, from the times it would have from rest to rest."""
        schedule = self.plan(request, course, np.zeros(self.limits.n))
        return Following(self.preferred(request), course.leaving(schedule.length * self.period_s))

    def preferred(self, request: MoveRequest) -> int:
        """Ta as asked for, in samples."""
        seconds = DEFAULT_TRANSITION_S if request.transition_s is None else request.transition_s
        return whole_samples(seconds, self.period_s)

    def needed(self, dv: Floats) -> int:
        """Least Ta, in samples, over a change of velocity `dv`. Shape (n,)."""
        seconds = float((np.abs(dv) / self.limits.a_planned).max()) * PEAK[self.blend] / 2.0
        return enough_samples(seconds, self.period_s)

    def _asked(self, request: MoveRequest, course: Course) -> int:
        return request.pace.samples(course.way, self.limits, self.period_s)

    def _least(self, course: Course) -> int:
        """Samples in which no joint passes its speed, nor, where the way bends, its acceleration."""
        speed = float((np.abs(course.rates) / self.limits.v_max).max())
        bend = float((np.abs(course.bends) / self.limits.a_planned).max())
        return enough_samples(max(speed, bend**0.5), self.period_s)

    def _ms(self, samples: int) -> str:
        return f"{1000.0 * samples * self.period_s:.0f} ms"
