"""Friction that falls with speed: Stribeck's term beside viscous and Coulomb friction, from passes or samples.

Near standstill a motor rubs more than at speed, by an excess for each direction that fades with a speed v_s:

    friction = viscous v + (coulomb + excess / (1 + (v / v_s)^2)) sign(v)          Hess and Soom 1990

Everything but the v_s is linear, so they are searched alone (`varpro`), as logarithms. An excess is known better than
its v_s: where a recording has few slow samples the interval of v_s says so. What the servo compensates has no such
term; with it, viscous and Coulomb friction are no longer bent by slow samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from qrobot.arrays import Floats, Ints
from qrobot.ident.fit import HUBER, NORMAL_95
from qrobot.ident.friction import BELIEVED
from qrobot.ident.model import Identified
from qrobot.ident.observe import Observer
from qrobot.ident.physical_gravity import with_gravity
from qrobot.ident.varpro import Projected, fit_separable
from qrobot.servo.memory.telemetry import Rows

CRAWLING: Final = 0.005  # of a joint's greatest speed: slower motors stick and slip
SPEED_DOUBT: Final = 1.0  # of the logarithm of v_s: a factor of e, until samples tell
_PER_MOTOR: Final = 5  # viscous, Coulomb and excess of both directions
_ROUNDS: Final = 3  # of weights
_FADED: Final = 50.0  # in log v_s: beyond, nothing changes any more
_MAD: Final = 1.4826


@dataclass(frozen=True, eq=False)
class StribeckFit:
    """Fitted friction near standstill; half widths are those of 95 % intervals.

    Attributes:
        linear, linear_half_width: of the columns given. Shape (p,).
        viscous: by motor, N m s/rad (N s/m). Shape (n,).
        coulomb, coulomb_half_width: of positive and of negative motion, N m (N). Shape (n, 2).
        excess, excess_half_width: what is added near standstill. Shape (n, 2).
        speed: v_s, rad/s (m/s). Shape (n,).
        speed_factor: the true v_s is between speed / factor and speed * factor. Shape (n,).
        scatter: standard deviation of a sample of each motor. Shape (n,).
    """

    linear: Floats
    linear_half_width: Floats
    viscous: Floats
    coulomb: Floats
    coulomb_half_width: Floats
    excess: Floats
    excess_half_width: Floats
    speed: Floats
    speed_factor: Floats
    scatter: Floats

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {name: value.tolist() for name, value in vars(self).items()}


@dataclass(frozen=True, eq=False)
class FrictionSamples:
    """Torques of motors, one row each: `linear` (m, p) is what multiplies that which is no friction, motor side."""

    linear: Floats
    motor: Ints
    rate: Floats
    torque: Floats

    def columns(self, x: Floats) -> Floats:
        """Columns of the linear values at v_s = exp(x). Shape (m, p + 5 n)."""
        share, direction = self._share(x), self._directions()
        own = np.column_stack([self.rate, direction, direction * share[:, None]])
        spread = np.zeros((len(own), x.size, _PER_MOTOR))
        spread[np.arange(len(own)), self.motor] = own
        return np.column_stack([self.linear, spread.reshape(len(own), x.size * _PER_MOTOR)])

    def slope(self, x: Floats, c: Floats) -> Floats:
        """Derivative of the torque by x. Shape (m, n)."""
        share = self._share(x)
        excess = c[self.linear.shape[1] :].reshape(x.size, _PER_MOTOR)[self.motor, -2:]
        by_own = 2.0 * share * (1.0 - share) * (self._directions() * excess).sum(axis=1)
        return np.where(self.motor[:, None] == np.arange(x.size), by_own[:, None], 0.0)

    def _share(self, x: Floats) -> Floats:
        """Share of the excess that is there at each sample's speed. Shape (m,)."""
        speed = np.exp(np.clip(x, -_FADED, _FADED))
        return np.asarray(1.0 / (1.0 + (self.rate / speed[self.motor]) ** 2))

    def _directions(self) -> Floats:
        return np.column_stack([self.rate > 0.0, -1.0 * (self.rate < 0.0)]).astype(np.float64)


def friction_of(found: Identified, rows: Rows, period_s: float) -> StribeckFit:
    """Friction at every speed, from the log (r,) that an arm was identified from; commanded torque.

    Raises:
        IdentificationError: the log does not tell it.
    """
    robot, v_max = found.robot, found.robot.limits.v_max
    better = with_gravity(robot, found.base, found.beta)
    observer = Observer(robot, found.regressor, found.base, better, found.scale, CRAWLING * v_max)
    seen = observer.observe(rows, period_s)
    samples = FrictionSamples(found.scale[seen.motor, None] * seen.gravity, seen.motor, seen.rate, seen.torque)
    return fit_stribeck(samples, robot.n, BELIEVED * v_max)


def fit_stribeck(samples: FrictionSamples, n: int, speed: Floats) -> StribeckFit:
    """Friction with Stribeck's term, and the linear values beside it, by robust least squares.

    Args:
        samples: of all motors, each in motion.
        n: how many motors there are.
        speed: v_s as it is believed beforehand, within some factors of e. Shape (n,).

    Raises:
        IdentificationError: the samples do not determine everything.
    """
    weight = np.ones(len(samples.torque))
    for _ in range(_ROUNDS):
        fitted = fit_separable(samples, samples.torque, weight, np.log(speed), SPEED_DOUBT)
        off = np.abs(fitted.residual)
        scatter = np.array([max(_MAD * float(np.median(off[samples.motor == j])), 1e-9) for j in range(n)])
        in_deviations = off / scatter[samples.motor]
        weight = np.sqrt(np.minimum(1.0, HUBER / np.maximum(in_deviations, 1e-12))) / scatter[samples.motor]
    return _in_words(fitted, samples.linear.shape[1], n, scatter)


def _in_words(fitted: Projected, p: int, n: int, scatter: Floats) -> StribeckFit:
    half = NORMAL_95 * np.sqrt(np.diag(fitted.covariance))
    own, own_half = (values[p : p + n * _PER_MOTOR].reshape(n, _PER_MOTOR) for values in (fitted.c, half))
    return StribeckFit(
        linear=fitted.c[:p],
        linear_half_width=half[:p],
        viscous=own[:, 0],
        coulomb=own[:, 1:3],
        coulomb_half_width=own_half[:, 1:3],
        excess=own[:, 3:],
        excess_half_width=own_half[:, 3:],
        speed=np.exp(fitted.x),
        speed_factor=np.exp(half[p + n * _PER_MOTOR :]),
        scatter=scatter,
    )
