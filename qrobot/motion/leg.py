"""One piece of path: a transition and the straight line behind it.

With t the time since its start and D the length of the transition (blend.py has beta and c):

    q(t) = q0 + v0 t + (v1 - v0) D beta(t/D) + a0 D^2 c(t/D)

Path time is counted in samples. It may run slower than the clock (a stop on the path does that): with the rate
r = d(path time)/d(time), velocities scale with r and accelerations are q'' r^2 + q' dr/dt.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from qrobot.motion.blend import Blend, absorb, beta
from qrobot.motion.limits import Floats
from qrobot.realtime.jit import kernel


@kernel
def evaluate(
    rows: Any, blend: int, length_s: float, elapsed_s: float, rate: float, rate_slope: float, state: Any
) -> None:
    """Fill `state` (3, n: q, v, a) from `rows` (4, n: q0, v0, a0, v1), `elapsed_s` after the start of the leg.

    `rate_slope` is dr/dt in 1/s. SI units.
    """
    h = elapsed_s / length_s
    b, b1, b2 = beta(blend, h)
    c, c1, c2 = absorb(h)
    for j in range(rows.shape[1]):
        v0, a0, dv = rows[1, j], rows[2, j], rows[3, j] - rows[1, j]
        slope = v0 + dv * b1 + a0 * length_s * c1
        bend = dv * b2 / length_s + a0 * c2
        state[0, j] = rows[0, j] + v0 * elapsed_s + (dv * b + a0 * length_s * c) * length_s
        state[1, j] = slope * rate
        state[2, j] = bend * rate * rate + slope * rate_slope


@dataclass(frozen=True, eq=False)
class Leg:
    """A piece of path that begins at path time `start`.

    Attributes:
        rows: q0, v0, a0, v1. Shape (4, n), SI units.
        start: path time, samples.
        length: of the transition (D = 2 Ta), samples.
    """

    rows: Floats
    start: float
    length: float

    @property
    def end(self) -> float:
        """Path time at which the transition is over."""
        return self.start + self.length

    def state(self, clock: float, period_s: float, blend: Blend, rate: float, slope: float, out: Floats) -> None:
        """Position, velocity and acceleration at path time `clock`, into `out` (3, n)."""
        elapsed_s = (clock - self.start) * period_s
        evaluate(self.rows, int(blend), self.length * period_s, elapsed_s, rate, slope, out)


def leg_from(state: Floats, v1: Floats, start: float, length: float) -> Leg:
    """The leg that begins with `state` (3, n: q, v, a) and ends with velocity `v1` (n,)."""
    return Leg(np.vstack((state, v1)), start, length)


def rest(q: Floats, start: float) -> Leg:
    """Stand at `q` (n,)."""
    rows = np.zeros((4, q.size))
    rows[0] = q
    return Leg(rows, start, 1.0)
