"""A stop on the path: path time slows down and stands still, so the arm never leaves the path it was on.

Over D samples the rate r of path time falls from r0, 1 at full speed, to 0 as r = r0 (1 - beta'(h)), h = t/D, so path
time advances by

    s(t) = r0 (t - D beta(h))        s(D) = r0 D/2        dr/dt = -r0 beta''(h)/D

A slope p that the rate has at its begin fades out in F samples: r is larger by p F g(t/F), g = h - 2 h^2 + h^3. F is so
short that r stays from 0 to 1; g is never more than PEAK_G, at h = 1/3.

On a Cartesian path that stands still the joints of the way to rest are solved for, and differences tell whether they
keep their limits. Where no stop that was tried does, the joints have to leave the path.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.motion.path.blend import PEAK, Blend, beta
from qrobot.motion.path.path import Path
from qrobot.motion.planning.joint_stop import all_can_stop_along
from qrobot.motion.planning.timing import Scheduler

_PROBES: Final = np.linspace(0.0, 1.0, 33)
_LONGER: Final = 1.15
_LONGEST_S: Final = 10.0
_TRIES: Final = 4  # [A] of stops on a Cartesian path, each longer than the one before by a third
_LONGER_LINE: Final = 4.0 / 3.0
_PEAK_G: Final = 4.0 / 27.0
_HALF: Final = 0.5  # of the stop, at most, for the slope to fade: half of the rate is left there


@dataclass(frozen=True)
class PathStop:
    """A stop that begins at path time `clock` and takes `length` samples.

    Attributes:
        clock: path time at which it begins.
        length: D, samples.
        blend: shape of the rate.
        rate: at its begin.
        slope: of the rate at its begin, per sample.
    """

    clock: float
    length: float
    blend: Blend
    rate: float = 1.0
    slope: float = 0.0

    def at(self, elapsed: float) -> tuple[float, float, float]:
        """(path time, r, dr/dt per sample), `elapsed` samples after the stop began."""
        b, b1, b2 = beta(int(self.blend), elapsed / self.length)
        if self.rate == 1.0:  # to the last bit what it always was
            return self.clock + elapsed - self.length * b, 1.0 - b1, -b2 / self.length
        more, more1, more2 = self._fading_slope(elapsed)
        return (
            self.clock + self.rate * (elapsed - self.length * b) + more,
            self.rate * (1.0 - b1) + more1,
            -self.rate * b2 / self.length + more2,
        )

    def _fading_slope(self, elapsed: float) -> tuple[float, float, float]:
        """Path time, rate and its slope that the slope at the begin adds."""
        room = _HALF * self.rate if self.slope < 0.0 else 1.0 - self.rate
        if self.slope == 0.0 or not room > 0.0:
            return 0.0, 0.0, 0.0
        fading = min(_HALF * self.length, room / (_PEAK_G * abs(self.slope)))
        h = min(elapsed / fading, 1.0)
        p, pf = self.slope, self.slope * fading
        passed = pf * fading * h * h * (0.5 + h * (0.25 * h - 2.0 / 3.0))
        return passed, pf * h * (1.0 + h * (h - 2.0)), p * (1.0 + h * (3.0 * h - 4.0))


def plan_path_stop(
    path: Path, clock: float, seconds: float, scheduler: Scheduler, rate: float = 1.0, slope: float = 0.0
) -> PathStop:
    """The shortest stop, of at least `seconds`, that keeps the limits of speed and acceleration on the path ahead.

    It visits places of the path alone: where a joint stands beyond its range it has begun there.

    Path time passes at `rate`, which changes by `slope` per sample.

    On a straight line it decelerates with a_stop; where the path itself accelerates it takes longer.
    """
    limits, blend, period_s = scheduler.limits, scheduler.blend, scheduler.period_s
    speed = np.abs(path.state(clock)[1])
    if path.segment is not None and not path.phase.ending:
        speed = np.maximum(speed, np.abs(path.segment.velocity))
    shortest = PEAK[blend] * float((rate * speed / limits.a_stop).max())
    length = max(1.0, seconds / period_s, shortest / period_s)
    path_stop = PathStop(clock, length, blend, rate, slope)
    while not _fits(path_stop, path, scheduler) and path_stop.length * period_s < _LONGEST_S:
        path_stop = replace(path_stop, length=_LONGER * path_stop.length)
    return path_stop


def plan_cartesian_stop(
    path: Path, clock: float, least_s: float, near: Floats, scheduler: Scheduler, rate: float, slope: float
) -> PathStop | None:
    """The first of some stops, of at least `least_s`, that keeps the limits on the Cartesian path ahead; None: no one.

    As `plan_path_stop`, with the joints at `near` (n,) now.
    """
    path_stop = PathStop(clock, max(1.0, least_s / scheduler.period_s), scheduler.blend, rate, slope)
    for _ in range(_TRIES):
        if _joints_keep_limits(path_stop, path, near, scheduler):
            return path_stop
        path_stop = replace(path_stop, length=_LONGER_LINE * path_stop.length)
    return None


def joints_ahead(path_stop: PathStop, path: Path, near: Floats, begin: float = 0.0) -> Iterator[Floats]:
    """Joint positions (n,) from `begin` samples after a stop began, at `near`, to its end, evenly over time.

    Raises Unreachable, JointLimit or Singular.
    """
    moments = (path_stop.at(begin + probe * (path_stop.length - begin)) for probe in _PROBES)
    for state in path.states_ahead(moments):
        near = path.coordinates.solve_at(state[0], near)
        yield near


def _joints_keep_limits(path_stop: PathStop, path: Path, near: Floats, scheduler: Scheduler) -> bool:
    try:
        joints = np.array(list(joints_ahead(path_stop, path, near)))
    except MotionError:  # the path itself leads where the arm cannot go
        return False
    return all_can_stop_along(joints, path_stop.length * scheduler.period_s / (_PROBES.size - 1), scheduler.limits)


def _fits(path_stop: PathStop, path: Path, scheduler: Scheduler) -> bool:
    moments = (path_stop.at(probe * path_stop.length) for probe in _PROBES)
    return all(scheduler.limits.allow_rates(v, a) for _, v, a in path.states_ahead(moments))
