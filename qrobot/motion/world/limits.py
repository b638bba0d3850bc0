"""Limits of the joints, and the sentences that say which joint would pass them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from qrobot.arrays import Bools, Floats
from qrobot.config import Robot
from qrobot.errors import JointLimit, MotionError, TooFast
from qrobot.units import DEG_PER_RAD

# Share of the acceleration limit that a planned motion uses; the rest lets a stop begin in the middle of a transition.
PLANNED_SHARE: Final = 0.9
_ROUNDING: Final = 1e-9  # of a velocity that was asked to be exactly at its limit


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Limits of the joints. Shape (n,), joint units (rad or m) and seconds.

    Attributes:
        q_min, q_max: range.
        v_max, a_max: largest speed and acceleration of a motion.
        a_stop: deceleration of a stop.
        prismatic: True where the joint slides.
        names: of the joints, for people.
        reduction: share of the speeds in the robot's file that `v_max` is.
    """

    q_min: Floats
    q_max: Floats
    v_max: Floats
    a_max: Floats
    a_stop: Floats
    prismatic: Bools
    names: tuple[str, ...]
    reduction: float = 1.0

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.names)

    @property
    def a_planned(self) -> Floats:
        """Largest acceleration of a planned motion. Shape (n,)."""
        return PLANNED_SHARE * self.a_max

    @cached_property
    def table(self) -> Floats:
        """q_min, q_max, v_max, a_max and a_stop for kernels. Shape (5, n)."""
        return np.array((self.q_min, self.q_max, self.v_max, self.a_max, self.a_stop))

    def slowed(self, share: float) -> MotionLimits:
        """The same limits with `share` of the speeds, 0 to 1; a share that is none changes nothing."""
        return replace(self, v_max=share * self.v_max, reduction=share * self.reduction) if 0.0 < share < 1.0 else self

    @cached_property
    def at_full_speed(self) -> MotionLimits:
        """The same limits with the speeds of the robot's file."""
        return replace(self, v_max=self.v_max / self.reduction, reduction=1.0) if self.reduction < 1.0 else self

    def check_position(self, q: Floats, what: str, start: Floats | None = None) -> None:
        """Look at a goal `q` (n,). A joint that begins outside its range, at `start` (n,), may stay there or come back.

        Raises:
            JointLimit: a joint would leave its range, or go farther out.
            MotionError: it is no position of this arm at all.
        """
        if q.shape != (self.n,) or not np.isfinite(q).all():
            raise MotionError(f"{what}: {self.n} finite joint positions needed, not {q.tolist()}")
        q_min, q_max = self._range_from(start)
        if (outside := (q < q_min) | (q > q_max)).any():
            j = int(outside.argmax())
            low, high = (self._place(j, limit[j]) for limit in (self.q_min, self.q_max))
            raise JointLimit(f"{what}: {self._joint(j)} at {self._place(j, q[j])} is outside {low} to {high}")

    def check_velocity(self, v: Floats, what: str, remedy: str, share: float = 0.0) -> None:
        """Raises TooFast, with `remedy` and `share`, when a velocity exceeds its limit, rounding apart."""
        self._check_rate(v, self.v_max, "s", what, remedy, share)

    def check_acceleration(self, a: Floats, what: str, remedy: str, share: float = 0.0) -> None:
        """Raises TooFast as `check_velocity` when an acceleration exceeds what may be planned, rounding apart."""
        self._check_rate(a, self.a_planned, "s2", what, remedy, share)

    def allow(self, state: Floats, start: Floats | None = None) -> bool:
        """True when position, velocity and acceleration, shape (3, n), are within the limits, rounding apart.

        `start` as in `check_position`.
        """
        q, v, a = state
        return self.contain(q, start) and self.allow_rates(v, a)

    def contain(self, q: Floats, start: Floats | None = None) -> bool:
        """True when positions (..., n) are inside the range, rounding apart; `start` as in `check_position`."""
        q_min, q_max = self._range_from(start)
        return bool(((q_min - _ROUNDING <= q) & (q <= q_max + _ROUNDING)).all())

    def allow_rates(self, v: Floats, a: Floats) -> bool:
        """True when velocity and acceleration, shapes (n,), are within the limits, rounding apart, wherever that is."""
        slow = np.abs(v) <= self.v_max * (1.0 + _ROUNDING)
        gentle = np.abs(a) <= self.a_max * (1.0 + _ROUNDING)
        return bool((slow & gentle).all())

    def _range_from(self, start: Floats | None) -> tuple[Floats, Floats]:
        """Range of a motion that begins at `start` (n,), None for somewhere inside. Shapes (n,)."""
        if start is None:
            return self.q_min, self.q_max
        return np.minimum(self.q_min, start - _ROUNDING), np.maximum(self.q_max, start + _ROUNDING)

    def _check_rate(self, values: Floats, limits: Floats, per: str, what: str, remedy: str, share: float) -> None:
        shares = np.abs(values) / limits
        j = int(shares.argmax())
        if not shares[j] <= 1.0 + _ROUNDING:
            asked = f"{abs(values[j]):.4g} {self._unit(j)}/{per}"
            raise TooFast(f"{what}: {self._joint(j)} would need {asked}, {limits[j]:.4g} allowed", remedy, share)

    def leaving(self, j: int, q: float) -> str:
        """Words for a joint, from 0, that would next be at `q` and leaves its range, or could not stop within it.

        One without a range is that of a frame, which could go on from there only a whole turn away.
        """
        here, low, high = (self._place(j, value) for value in (q, self.q_min[j], self.q_max[j]))
        if math.isinf(self.q_min[j]) and math.isinf(self.q_max[j]):
            return f"{self._joint(j)} at {here} could go on only a whole turn away"
        does = "could not stop within" if self.q_min[j] <= q <= self.q_max[j] else "would leave"
        return f"{self._joint(j)} at {here} {does} its range, {low} to {high}"

    def _joint(self, j: int) -> str:
        return f"joint {j + 1} ({self.names[j]})"

    def _unit(self, j: int) -> str:
        return "m" if self.prismatic[j] else "rad"

    def _place(self, j: int, q: float) -> str:
        return f"{q:.4f} m" if self.prismatic[j] else f"{q * DEG_PER_RAD:.2f} deg"


def motion_limits(robot: Robot) -> MotionLimits:
    """The limits in the robot's file."""
    limits = robot.limits
    return MotionLimits(
        limits.q_min, limits.q_max, limits.v_max, limits.a_max, robot.guard.a_stop, robot.prismatic, robot.joint_names
    )
