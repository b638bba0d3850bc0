"""Number of samples that a segment and its transitions take.

A segment of T samples between two via points begins with a transition whose second half (Ta) lies in it and ends with
one whose first half does, so T >= Ta + the next Ta; T is stretched until that holds (Paul asks for T >= 2 Ta). A
transition over a change of velocity dv needs 2 Ta >= PEAK |dv| / a_max.

Where a request leaves Ta open it is a share of T, at most DEFAULT_TRANSITION_S, at least what the joints need, and T is
the shortest that has room for it. A joint gathers full speed in no less than OPEN_RAMP_S: what an arm follows whose
load nobody told of. It stays DEFAULT_TRANSITION_S in Cartesian mode and in a motion that a force may end, near things
where haste is felt as force; on a way to a goal that moves, whose speed comes on top and is not known when the length
is; and in a motion to where the arm is already.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.motion.path.blend import PEAK, Blend
from qrobot.motion.path.coordinates import JOINTS, DriveCoordinates
from qrobot.motion.path.segment import Schedule
from qrobot.motion.planning.geometric_path import GeometricPath
from qrobot.motion.planning.queued_motion import NO_FOLLOWER, Following
from qrobot.motion.request import MoveRequest, enough_samples, whole_samples
from qrobot.motion.world.limits import MotionLimits

DEFAULT_TRANSITION_S: Final = 0.2  # the transition time of the crank example, Hayward & Paul 1986
OPEN_SHARE: Final = 1.0 / 7.0  # [A] of T; the ways of the QRobot paper's experiment keep the 0.2 s
OPEN_RAMP_S: Final = 0.2  # [A] half a transition from rest to full speed, at least
NO_DISPLACEMENT: Final = 1e-3  # [A] rad or m: so near the goal an arm at rest is where it was asked to be


MANY: Final = 1 << 30  # samples; more than any transition takes


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

    def check(self, request: MoveRequest, geometry: GeometricPath) -> None:
        """Judge a request that begins and ends at rest.

        What the arm can do at full speed is allowed at reduced speed as well: it takes as much longer as it has to.

        Raises:
            JointLimit: the target is outside the joints' range.
            TooFast: the time, the speed or the transition asks for more than the arm can do.
        """
        if self.limits.reduction < 1.0:
            replace(self, limits=self.limits.at_full_speed).check(request, geometry)
            return
        what = f"move to {request.name}"
        ta = self.preferred(request)
        asked = self._asked(request, geometry)
        length = max(asked, 2 * ta)
        v = np.abs(geometry.dq_ds).max(axis=0) / (length * self.period_s)
        a = np.abs(geometry.ddq_dds).max(axis=0) / (length * self.period_s) ** 2
        least = self._least(geometry)
        remedy, share = f"give it {self._ms(least)} or more", min(asked / least, 1.0)
        self.limits.check_velocity(v, what, remedy, share)
        self.limits.check_acceleration(a, what, remedy, share)
        if request.transition_s is not None:
            entering = PEAK[self.blend] * v / (2 * ta * self.period_s)
            needed = self._ms(self.needed(v))
            self.limits.check_acceleration(entering, what, f"give the transition {needed} or more")

    def plan(
        self,
        request: MoveRequest,
        geometry: GeometricPath,
        v0: Floats,
        least: int = 1,
        most: int = MANY,
        following: Following = NO_FOLLOWER,
        rest: int = 1,
    ) -> Schedule:
        """A schedule that keeps the limits, stretching times where needed.

        Args:
            request: what was asked.
            geometry: the path from via point to via point.
            v0: joint velocity before the transition. Shape (n,).
            least, most: wanted bounds of the transition, in samples; longer than `most` only when the arm needs it.
            following: what the request behind it asks for, when there is one.
            rest: least Ta of the transition to rest, samples.
        """
        asked = max(self._asked(request, geometry), self._least(geometry))
        if request.transition_s is None:
            share = self._open_share(request, geometry)
            return _shortest(asked, partial(self._open, geometry, v0, least, most, following, rest, share))
        resting, turning = max(self.preferred(request), rest), following.transition
        transition = max(min(resting, most), least)
        while True:  # all transitions only grow, and what they need is bounded by the speed asked for
            length = max(asked, transition + max(resting, turning))
            if self.limits.reduction < 1.0:  # what was stretched lies at the limit: each setpoint is to keep it
                length = max(length, self._least(geometry, transition))
            seconds = length * self.period_s
            entering, least_resting = (
                self.needed(geometry.leaving(seconds) - v0),
                self.needed(geometry.arriving(seconds)),
            )
            turn = self._turning(geometry.arriving(seconds), following)
            if entering <= transition and least_resting <= resting and turn <= turning:
                return Schedule(transition, length, least_resting, resting)
            transition, resting, turning = max(transition, entering), max(resting, least_resting), max(turning, turn)

    def _open(
        self, geometry: GeometricPath, v0: Floats, least: int, most: int, following: Following, rest: int, share: float,
        length: int,
    ) -> Schedule | None:  # fmt: skip
        """The times of a request of `length` samples that leaves Ta open, None when they are too short."""
        seconds = length * self.period_s
        arriving, dv = geometry.arriving(seconds), geometry.leaving(seconds) - v0
        wished = max(self._default(share * seconds), self._ramp(dv))
        least_resting, turning = self.needed(arriving), max(following.transition, self._turning(arriving, following))
        transition = max(min(wished, most), least, self.needed(dv))
        resting = max(self._default(share * seconds), self._ramp(arriving), least_resting, rest)
        enough = self._least(geometry, transition) <= length
        fits = transition + max(resting, turning) <= length
        return Schedule(transition, length, least_resting, resting) if enough and fits else None

    def _open_share(self, request: MoveRequest, geometry: GeometricPath) -> float:
        """Ta over T where it is left open; without end where it is to be DEFAULT_TRANSITION_S."""
        nowhere = float(np.abs(geometry.displacement.joints).max()) <= NO_DISPLACEMENT
        near_things = request.limits is not None or isinstance(geometry.coordinates, DriveCoordinates)
        return inf if nowhere or near_things or not geometry.coordinates.fixed else OPEN_SHARE

    def _default(self, seconds: float) -> int:
        """An open Ta of `seconds`, in samples: DEFAULT_TRANSITION_S at most."""
        return whole_samples(min(seconds, DEFAULT_TRANSITION_S), self.period_s)

    def _ramp(self, dv: Floats) -> int:
        """An open Ta, in samples, that a change of velocity `dv` is to have at least. Shape (n,)."""
        share = float((np.abs(dv) / self.limits.v_max).max())
        return min(enough_samples(OPEN_RAMP_S * share, self.period_s), self._default(DEFAULT_TRANSITION_S))

    def _turning(self, arriving: Floats, following: Following) -> int:
        """Least Ta, in samples, of the transition into what follows."""
        return 0 if following.leaving is None else self.needed(following.leaving - arriving)

    def alone(self, request: MoveRequest, geometry: GeometricPath) -> Following:
        """Demand of a request on the one before it, from the times it would have from rest to rest."""
        schedule = self.plan(request, geometry, np.zeros(self.limits.n))
        ta = schedule.transition if request.transition_s is None else self.preferred(request)
        return Following(ta, geometry.leaving(schedule.length * self.period_s))

    def preferred(self, request: MoveRequest) -> int:
        """Ta as asked for, in samples; where it is open the longest it may be."""
        seconds = DEFAULT_TRANSITION_S if request.transition_s is None else request.transition_s
        return whole_samples(seconds, self.period_s)

    def needed(self, dv: Floats) -> int:
        """Least Ta, in samples, over a change of velocity `dv`. Shape (n,)."""
        seconds = float((np.abs(dv) / self.limits.a_planned).max()) * PEAK[self.blend] / 2.0
        return enough_samples(seconds, self.period_s)

    def _asked(self, request: MoveRequest, geometry: GeometricPath) -> int:
        return request.speed.samples(geometry.displacement, self.limits, self.period_s)

    def _least(self, geometry: GeometricPath, transition: int = MANY) -> int:
        """Samples in which no joint passes its speed, nor, where the way bends, its acceleration.

        Where each setpoint is judged its speed is that of the parabola through three of them, which at the end of a
        transition of 2 Ta samples is too high by 2 / (2 Ta)^2 of the change.
        """
        lag = 0.0 if geometry.coordinates is JOINTS else 0.5 / transition**2
        speed = float((np.abs(geometry.dq_ds) / self.limits.v_max).max()) * (1.0 + lag)
        bend = float((np.abs(geometry.ddq_dds) / self.limits.a_planned).max())
        return enough_samples(max(speed, bend**0.5), self.period_s)

    def _ms(self, samples: int) -> str:
        return f"{1000.0 * samples * self.period_s:.0f} ms"


def _shortest(asked: int, of_length: Callable[[int], Schedule | None]) -> Schedule:
    """The first of the schedules `of_length` T, from `asked` on, that there is."""
    short, length = asked - 1, asked
    while (found := of_length(length)) is None:
        short, length = length, 2 * length
    while length - short > 1:
        middle = (short + length) // 2
        schedule = of_length(middle)
        if schedule is None:
            short = middle
        else:
            found, length = schedule, middle
    return found
