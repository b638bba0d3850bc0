"""The path of all that was asked for, before it runs: joint positions and their derivatives at any time.

Between two samples the path is what the generator would evaluate there: pieces of path in their coordinates. At a
sample it is the setpoint, to the bit.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.motion.event import MotionEvent
from qrobot.motion.path.coordinates import JOINTS, Coordinates
from qrobot.motion.path.path_piece import BlendSettings, PathPiece
from qrobot.motion.planning.path_stop import PathStop

_STEP: Final = 0.01  # samples, of the differences that give the derivatives of a Cartesian path [A]
_ROUNDING: Final = 1e-6  # samples: a time so near to that of a sample is that of the sample


@dataclass(frozen=True, eq=False)
class PathSample:
    """Path that the generator follows at one sample, and until the next.

    Attributes:
        tick: its number.
        q: setpoint. Shape (n,).
        clock: path time, samples.
        piece: the piece of path.
        coordinates: those of the piece.
        path_stop: that slows path time down, with the sample at which it began; None when time passes as usual.
        events: what happened since the sample before.
    """

    tick: int
    q: Floats
    clock: float
    piece: PathPiece
    coordinates: Coordinates
    path_stop: tuple[PathStop, int] | None
    events: tuple[MotionEvent, ...]

    def moment(self, elapsed: float) -> tuple[float, float, float]:
        """(path time, its rate, change of the rate per sample) `elapsed` samples later."""
        if self.path_stop is None:
            return self.clock + elapsed, 1.0, 0.0
        path_stop, begin = self.path_stop
        return path_stop.at(self.tick - begin + elapsed)


class PlannedPath:
    """Joint positions, velocities and accelerations of a motion as functions of time.

    Args:
        samples: of the generator, one after the other.
        settings: of the pieces.

    Attributes:
        period_s: sample period.
    """

    def __init__(self, samples: list[PathSample], settings: BlendSettings) -> None:
        self.period_s = settings.period_s
        self._samples, self._settings = samples, settings
        self._ticks = [sample.tick for sample in samples]

    @property
    def duration_s(self) -> float:
        """Time from the first sample to the last, at which the arm is at rest and nothing waits."""
        return (self._ticks[-1] - self._ticks[0]) * self.period_s

    @property
    def t(self) -> Floats:
        """Times of the samples, s; the first is 0. Shape (samples,)."""
        return (np.array(self._ticks) - self._ticks[0]) * self.period_s

    @property
    def q(self) -> Floats:
        """Setpoints of the samples, rad or m. Shape (samples, n)."""
        return np.array([sample.q for sample in self._samples])

    @property
    def events(self) -> list[tuple[float, MotionEvent]]:
        """Events to come, with their time in seconds: which motion begins or ends."""
        return [(float(t), event) for t, sample in zip(self.t, self._samples, strict=True) for event in sample.events]

    def at(self, t: float) -> Floats:
        """Position, velocity and acceleration of the joints at time `t` (s). Shape (3, n), rad or m and seconds.

        Positions at samples are the setpoints, to the bit. Derivatives are exact on joint paths; those of a Cartesian
        path are differences, good to 1e-3 of the arm's limits. Where two pieces meet the later one counts.

        Raises:
            MotionError: the time is no number, before the path or after it.
            Unreachable, JointLimit, Singular: there is no solution between two samples of a Cartesian path.
        """
        if isinstance(t, bool) or not isinstance(t, int | float | np.number):
            raise MotionError(f"a time in seconds is needed, not {t!r}")
        if not 0.0 <= t <= self.duration_s + _ROUNDING * self.period_s:
            raise MotionError(f"the path lasts from 0 to {self.duration_s:g} s, and says nothing of {t:g} s")
        place = self._ticks[0] + t / self.period_s
        if abs(place - round(place)) <= _ROUNDING:
            place = round(place)
        sample = self._sample_for(place)
        if sample.coordinates is JOINTS:
            state = self._joint_state(sample, place - sample.tick)
        else:
            state = self._differences(sample, place - sample.tick)
        if place == sample.tick:
            state[0] = sample.q
        return state

    def table(self, times: Floats) -> Floats:
        """`at` of several times (k,), which may be none. Shape (k, 3, n). Raises what `at` raises."""
        return np.array([self.at(t) for t in times]).reshape(-1, 3, self._samples[0].q.size)

    def _sample_for(self, place: float) -> PathSample:
        """The sample whose piece counts at `place`: the one before, or the next when its piece has begun by then."""
        k = min(bisect_right(self._ticks, place), len(self._ticks)) - 1
        sample = self._samples[k]
        if place == sample.tick or k + 1 == len(self._samples):
            return sample
        following = self._samples[k + 1]
        renewed = following.piece is not sample.piece and following.path_stop is None
        begun = following.piece.start <= following.clock - (following.tick - place)
        return following if renewed and begun else sample

    def _joint_state(self, sample: PathSample, elapsed: float) -> Floats:
        clock, rate, slope = sample.moment(elapsed)
        return sample.piece.state(clock, self._settings, rate, slope / self.period_s)

    def _differences(self, sample: PathSample, elapsed: float) -> Floats:
        """The state of a Cartesian path `elapsed` samples after `sample`. Shape (3, n)."""
        h = _STEP * self.period_s
        before, now, after = (self._solve(sample, elapsed + step) for step in (-_STEP, 0.0, _STEP))
        return np.array((now, (after - before) / (2.0 * h), (after - 2.0 * now + before) / h**2))

    def _solve(self, sample: PathSample, elapsed: float) -> Floats:
        """Joint positions (n,) `elapsed` samples after `sample`."""
        clock, _, _ = sample.moment(elapsed)
        return sample.coordinates.solve_at(sample.piece.state(clock, self._settings)[0], sample.q)
