"""A short way back after a collision: along the path just travelled, slowly, then rest.

The servo stops an arm that meets something, and holds it where it got to, often in touch
(`servo.stages.collision_stop`). Where a program wants that, its library takes the arm again, and leads it back over the
setpoints that it had sent: the way by which the arm came was free a moment ago. What the arm stands off its path by
fades out on the way.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.polynomial import Chebyshev

from qrobot.arrays import Floats
from qrobot.errors import LinkError, ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.motion.kept.way_back import ToolPose, WayBackLimit
from qrobot.motion.trajectory.setpoint_player import SetpointPlayer
from qrobot.motion.world.limits import MotionLimits

MOST_SETPOINTS: Final = 1000  # that are remembered, of an arm that moves
MOVED: Final = 1e-6  # rad or m: less is rest
RECENT_S: Final = 0.5  # [A] by which the arm, stopped by the servo, may be behind the newest setpoint
BEHIND: Final = 8  # [A] samples, of play-out, look-ahead and the answer's way, besides
MOST_TURN: Final = WayBackLimit().turn  # of any joint, rad; one that slides moves the flange by as much
NEAR: Final = 0.01  # [A] rad or m: by so much the way may differ from what was travelled
SHARE: Final = 0.1  # [A] of the joints' greatest speeds
FLANGE_M_S: Final = 0.1  # [A]
SHORTEST_S: Final = 0.4  # [A]
DEGREE: Final = 7  # of the polynomials that the joints go by
PIECES: Final = 16  # along which the flange is followed
LAST: Final = 6  # samples at the end, until the servo has followed
PEAK: Final = 1.875  # of the quintic's speed, its mean being 1
ACCELERATION: Final = 0.25  # [A] of the joints' greatest
STRETCH: Final = 1.25


class TravelledPath:
    """The newest setpoints of an arm that moved."""

    def __init__(self) -> None:
        self._q: deque[list[float]] = deque(maxlen=MOST_SETPOINTS)

    def note(self, q: Floats) -> None:
        """Remember a setpoint (n,), unless the arm rests there."""
        here = q.tolist()
        if not self._q or _moved(self._q[-1], here):
            self._q.append(here)

    def forget(self) -> None:
        """Begin anew: what follows comes from elsewhere."""
        self._q.clear()

    def way_back(self, q: Floats, length_m: float, forward: ToolPose, recent: int) -> Floats:
        """Places from `q` (n,) back over them, until the flange has gone `length_m`, or where it begins.

        The arm is near one of the `recent` newest, or was pushed back along the way from there. It may have been here
        before as well, on a way that led where it now met something.

        Returns:
            Shape (k, n), the first of them `q`; alone when there are none. No joint turns by more than `MOST_TURN`.
        """
        if not self._q:
            return q[None].copy()
        travelled = np.array(self._q)
        newest_first = travelled[::-1]
        off = np.linalg.norm(newest_first - q, axis=1)
        nearest = int(off[:recent].argmin())
        while nearest + 1 < len(off) and off[nearest + 1] <= off[nearest]:  # it was pushed back along it
            nearest += 1
        back = newest_first[nearest:]
        turned = np.abs(np.diff(back, axis=0)).cumsum(axis=0).max(axis=1, initial=0.0)
        back = back[: 1 + int(np.searchsorted(turned, MOST_TURN, side="right"))]
        places = np.array([forward(each)[:3, 3] for each in back])
        gone = np.concatenate([[0.0], np.linalg.norm(np.diff(places, axis=0), axis=1).cumsum()])
        count = max(1, int(np.searchsorted(gone, length_m, side="right")))
        way = back[: count + 1].copy()
        if len(way) > count:  # the last piece, as far as it goes
            way[-1] = way[-2] + (length_m - gone[count - 1]) / (gone[count] - gone[count - 1]) * (way[-1] - way[-2])
        share = np.linspace(1.0, 0.0, len(way))[:, None]
        way += share**2 * (3.0 - 2.0 * share) * (q - way[0])
        return way


def _moved(before: list[float], after: list[float]) -> bool:
    """Whether any joint has moved. Called in each sample, where NumPy takes a tenth of the trajectory task's time."""
    return any(abs(now - then) > MOVED for then, now in zip(before, after, strict=True))


def slow_setpoints(way: Floats, limits: MotionLimits, period_s: float, forward: ToolPose) -> Floats:
    """Setpoints along a way (k, n), from rest to rest, within shares of speed and acceleration. Shape (samples, n).

    A way that is too winding for a smooth one near it is gone as far as it is not.
    """
    steps = (np.abs(np.diff(way, axis=0)) / limits.v_max).max(axis=1)
    moved = np.concatenate([[True], steps > 0.0])
    at, way = np.concatenate([[0.0], steps.cumsum()])[moved], way[moved]
    if len(way) < 2:
        return np.repeat(way[:1], LAST, axis=0)
    fitted = _fitted(at / at[-1], way)
    while len(way) > 2 and np.abs(fitted(at / at[-1]) - way).max() > NEAR:
        at, way = at[: len(way) // 2 + 1], way[: len(way) // 2 + 1]
        fitted = _fitted(at / at[-1], way)
    places = np.array([forward(q)[:3, 3] for q in fitted(np.linspace(0.0, 1.0, PIECES + 1))])
    flange_m = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    seconds = max(SHORTEST_S, PEAK * float(at[-1]) / SHARE, PEAK * flange_m / FLANGE_M_S)
    while not _gentle(q := fitted(_clock(seconds, period_s)), limits, period_s):
        seconds *= STRETCH
    return q


def _fitted(at: Floats, way: Floats) -> Callable[[Floats], Floats]:
    """Smooth places (k, n) of `at` (k,), from 0 to 1, along a way, through both its ends."""
    joints = [Chebyshev.fit(at, joint, min(DEGREE, len(way) - 1), domain=(0.0, 1.0)) for joint in way.T]
    ends = np.array([[joint(0.0), joint(1.0)] for joint in joints]).T
    first, last = way[0] - ends[0], way[-1] - ends[1]

    def fitted(s: Floats) -> Floats:
        bent = np.column_stack([joint(s) for joint in joints])
        q: Floats = bent + np.outer(1.0 - s, first) + np.outer(s, last)
        return q

    return fitted


def _clock(seconds: float, period_s: float) -> Floats:
    """Share of the way at each sample: 0 to 1 in so many seconds, from rest to rest, and a few samples more."""
    s = np.minimum(np.arange(int(seconds / period_s) + 2 + LAST) * period_s / seconds, 1.0)
    clock: Floats = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    return clock


def _gentle(q: Floats, limits: MotionLimits, period_s: float) -> bool:
    v, a = np.abs(np.diff(q, axis=0)) / period_s, np.abs(np.diff(q, n=2, axis=0)) / period_s**2
    return bool((v <= 2.0 * SHARE * limits.v_max).all() and (a <= ACCELERATION * limits.a_max).all())


class Retreat:
    """Leads an arm back from what it has met: a little, and once each time.

    Attributes:
        fault: with which the servo has stopped the arm that goes back; None while it does not.
    """

    def __init__(self) -> None:
        self.fault: ServoFault | LinkError | None = None
        self._travelled = TravelledPath()
        self._length_m, self._halted = 0.0, False
        self._player: SetpointPlayer | None = None

    def note(self, q: Floats, wanted: bool) -> None:
        """Remember a setpoint (n,) of a motion, where a way back is wanted; else forget those before it, too."""
        if wanted:
            self._travelled.note(q)
        else:
            self._travelled.forget()

    def forget(self) -> None:
        """The motions to come begin elsewhere."""
        self._travelled.forget()

    def wanted(self, fault: ServoFault | LinkError, length_m: float) -> bool:
        """Whether an arm that the servo has stopped with `fault` is to be taken again, and to go back by `length_m`.

        It is when it has met something, unless that was on the way back itself; `length_m` of 0 is no way.
        """
        again, self.fault = self.fault is not None, None
        met = isinstance(fault, ServoFault) and fault.code == FaultCode.COLLISION
        if not met or again or length_m == 0.0:
            return False
        self.fault, self._length_m, self._player, self._halted = fault, length_m, None, False
        return True

    def begin(self, q: Floats, limits: MotionLimits, period_s: float, forward: ToolPose) -> None:
        """The arm is held at `q` (n,)."""
        recent = BEHIND + int(RECENT_S / period_s)
        way = q[None] if self._halted else self._travelled.way_back(q, self._length_m, forward, recent)
        self._player = SetpointPlayer(slow_setpoints(way, limits, period_s, forward), period_s, limits)

    def step(self, tick: int, paused: bool) -> Floats:
        """The setpoint of sample `tick`. Shape (n,). A pause ends the way where the arm comes to rest."""
        assert self._player is not None  # it has begun
        if paused:
            self.stop()
        return self._player.step(tick)

    @property
    def over(self) -> ServoFault | LinkError | None:
        """The fault, once the arm is there or has come to rest on its way; None before."""
        return self.fault if self._player is not None and self._player.done else None

    def stop(self) -> None:
        """Come to rest on the way, or do not begin it."""
        self._halted = True
        if self._player is not None:
            self._player.stop()
