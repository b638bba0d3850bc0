"""Forms of interpolation: polynomials between setpoints, each a table of numbers.

Every form reads four successive setpoints k0..k3, the knots, as k0 and the three steps between them:

    p(u) = k0 + sum over m of u^m (c_m1 (k1 - k0) + c_m2 (k2 - k1) + c_m3 (k3 - k2))          0 <= u <= 1, in frames

The table c is all the compiled interpolator knows of a form (`servo.kernels.interpolator`), and all there is to know:
delay, continuity, and which motions come out exactly, follow from it by algebra. At rest every step is zero, so every
form stands still to the last bit.

A form that is faster between the setpoints than its steps has one more column b: where that would be too fast, the
reference passes beside knot 1 by e1 and beside knot 2 by e2 (`servo.kernels.rounding`), on p(u) + e1 + b(u) (e2 - e1).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.polynomial import Polynomial

from qrobot.arrays import Floats
from qrobot.errors import ConfigError

N_KNOTS: Final = 4
N_POWERS: Final = 6
BLEND: Final = N_KNOTS - 1  # its column in the table
_ROUNDING: Final = 1e-12

Steps = tuple[float, float, float]


@dataclass(frozen=True)
class Form:
    """One form of interpolation.

    Attributes:
        name: what a deployment file calls it.
        coefficients: c, one row per power of u from 0, at most `N_POWERS`; columns are the steps k1-k0, k2-k1, k3-k2.
        about: one line for people.
        blend: b, powers of u from 0: from 0 to 1 within a frame, as smooth at its ends as the form. None where the
            reference is never faster than the steps.
    """

    name: str
    coefficients: tuple[Steps, ...]
    about: str
    blend: tuple[float, ...] = ()

    @property
    def table(self) -> Floats:
        """The coefficients with every power spelled out, and the blend behind them, for the kernels. Shape (6, 4)."""
        table = np.zeros((N_POWERS, N_KNOTS))
        table[: len(self.coefficients), :BLEND] = self.coefficients
        table[: len(self.blend), BLEND] = self.blend
        return table

    @property
    def first_knot(self) -> int:
        """The knot at which a frame begins: where a straight line through the knots is at u = 0."""
        return round(sum(self.coefficients[0]))

    @property
    def delay_frames(self) -> int:
        """Frames from taking a setpoint, the newest knot, to reaching it."""
        return N_KNOTS - 1 - self.first_knot

    @cached_property
    def continuity(self) -> int:
        """Highest derivative that is continuous from frame to frame, whatever the setpoints: 0 is position alone."""
        order = 0
        while order < N_POWERS - 1 and self._joins(order + 1):
            order += 1
        return order

    @property
    def degree(self) -> int:
        """Highest degree of motion that comes out exactly, `delay_frames` late."""
        degree = 0
        while degree < N_POWERS - 1 and self._reproduces(degree + 1):
            degree += 1
        return degree

    @property
    def through_setpoints(self) -> bool:
        """The reference passes through every setpoint."""
        return self.coefficients[0] == tuple(float(step < self.first_knot) for step in range(N_KNOTS - 1))

    def _joins(self, order: int) -> bool:
        """Derivative `order` at the end of a frame is the one at the beginning of the next, as sums of four steps."""
        end, begin = np.zeros(N_KNOTS), np.zeros(N_KNOTS)
        for step in range(N_KNOTS - 1):
            derivative = Polynomial(self.table[:, step]).deriv(order)
            end[step], begin[step + 1] = derivative(1.0), derivative(0.0)
        return bool(np.allclose(end, begin, rtol=0.0, atol=_ROUNDING))

    def _reproduces(self, power: int) -> bool:
        """Knots k_i = i^power give p(u) = (first knot + u)^power."""
        steps = np.diff(np.arange(N_KNOTS, dtype=np.float64) ** power)
        wanted = np.zeros(N_POWERS)
        wanted[: power + 1] = (Polynomial([self.first_knot, 1.0]) ** power).coef
        return bool(np.allclose(self.table[:, :BLEND] @ steps, wanted, rtol=0.0, atol=_ROUNDING))


LINEAR: Final = Form(
    "linear",
    ((1.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "straight from setpoint to setpoint; the velocity jumps at each",
)
# v_i = (k_{i+1} - k_{i-1}) / 2: the spline of Catmull and Rom, 1974
CUBIC: Final = Form(
    "cubic",
    ((1.0, 0.0, 0.0), (0.5, 0.5, 0.0), (-1.0, 1.5, -0.5), (0.5, -1.0, 0.5)),
    "through every setpoint; the velocity there is the central difference, the acceleration jumps",
    (0.0, 0.0, 3.0, -2.0),
)
# v_i = (k_{i+1} - k_{i-1}) / 2, a_i = k_{i+1} - 2 k_i + k_{i-1}
QUINTIC: Final = Form(
    "quintic",
    (
        (1.0, 0.0, 0.0),
        (0.5, 0.5, 0.0),
        (-0.5, 0.5, 0.0),
        (-1.5, 3.0, -1.5),
        (2.5, -5.0, 2.5),
        (-1.0, 2.0, -1.0),
    ),
    "through every setpoint; velocity and acceleration there are central differences",
    (0.0, 0.0, 0.0, 10.0, -15.0, 6.0),
)
B_SPLINE: Final = Form(
    "b-spline",
    ((5 / 6, 1 / 6, 0.0), (0.5, 0.5, 0.0), (-0.5, 0.5, 0.0), (1 / 6, -1 / 3, 1 / 6)),
    "cubic B-spline: passes beside the setpoints where the path bends, and never overshoots them",
)

FORMS: Final[dict[str, Form]] = {form.name: form for form in (LINEAR, CUBIC, QUINTIC, B_SPLINE)}
DEFAULT_FORM: Final = QUINTIC.name


def find_form(name: str) -> Form:
    """The form called `name`. Raises ConfigError naming those there are."""
    try:
        return FORMS[name]
    except KeyError:
        raise ConfigError(f"no interpolation {name!r}; there are: {', '.join(FORMS)}") from None
