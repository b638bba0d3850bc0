"""One piece of path: a transition and the straight line behind it.

With t the time since its start and D the length of the transition (blend.py has beta, c and the fading polynomial f):

    x(t) = x0 + u0 t + (v1 - u0) D beta(t/D) + (v0 - u0) D f(t/D) + a0 A^2 c(t/A)

u0 is the velocity that leads to the via point, v0 the one the arm really has; they differ when frames move or the mode
changes, and the difference is faded out. So is an acceleration left over, in A = D unless it has to be sooner. Path
time is counted in samples. It may run slower than the clock (a stop on the path does that): with the rate
r = d(path time)/d(time), velocities scale with r and accelerations are x'' r^2 + x' dr/dt.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from qrobot.arrays import Floats
from qrobot.motion.path.blend import Blend, Correction, absorb, beta, fade
from qrobot.realtime.jit import kernel


@kernel
def evaluate(
    rows: Any,
    blend: int,
    correction: int,
    length_s: float,
    elapsed_s: float,
    rate: float,
    rate_slope: float,
    state: Any,
) -> None:
    """Fill `state` (3, m: x, v, a) from `rows` (6, m: x0, v0, a0, u0, v1, A/D), `elapsed_s` after the piece began.

    `rate_slope` is dr/dt in 1/s. SI units.
    """
    h = elapsed_s / length_s
    b, b1, b2 = beta(blend, h)
    f, f1, f2 = fade(correction, h)
    for j in range(rows.shape[1]):
        a0, u0, fading_s = rows[2, j], rows[3, j], length_s * rows[5, j]
        c, c1, c2 = absorb(h / rows[5, j])
        extra, dv = rows[1, j] - u0, rows[4, j] - u0
        slope = u0 + dv * b1 + extra * f1 + a0 * fading_s * c1
        bend = (dv * b2 + extra * f2) / length_s + a0 * c2
        state[0, j] = rows[0, j] + u0 * elapsed_s + (dv * b + extra * f) * length_s + a0 * fading_s * c * fading_s
        state[1, j] = slope * rate
        state[2, j] = bend * rate * rate + slope * rate_slope


@dataclass(frozen=True)
class BlendSettings:
    """Settings of the pieces' polynomials.

    Attributes:
        period_s: sample period.
        blend: polynomial of the transitions.
        correction: polynomial that fades out unexpected velocity.
    """

    period_s: float
    blend: Blend = Blend.QUARTIC
    correction: Correction = Correction.SMOOTH


@dataclass(frozen=True, eq=False)
class PathPiece:
    """A piece of path that begins at path time `start`.

    Attributes:
        rows: x0, v0, a0, u0, v1, A/D. Shape (6, m), SI units.
        start: path time, samples.
        length: of the transition (D), samples.
    """

    rows: Floats
    start: float
    length: float

    @property
    def end(self) -> float:
        """Path time at which the transition is over."""
        return self.start + self.length

    def state(self, clock: float, settings: BlendSettings, rate: float = 1.0, slope: float = 0.0) -> Floats:
        """Position, velocity and acceleration at path time `clock`. Shape (3, m)."""
        out = np.empty((3, self.rows.shape[1]))
        elapsed_s, length_s = (clock - self.start) * settings.period_s, self.length * settings.period_s
        evaluate(self.rows, int(settings.blend), int(settings.correction), length_s, elapsed_s, rate, slope, out)
        return out


def piece_from_state(state: Floats, v1: Floats, start: float, length: float, fading: Floats | None = None) -> PathPiece:
    """The piece that begins with `state` (3, m: x, v, a), heading straight on, and ends with velocity `v1` (m,).

    The acceleration fades out in the shares `fading` (m,) of the length, above 0; else in all of it.
    """
    return PathPiece(np.vstack((state, state[1], v1, np.ones_like(v1) if fading is None else fading)), start, length)


def piece_joining_line(
    state: Floats, via: Floats, via_clock: float, v1: Floats, start: float, length: float, period_s: float
) -> PathPiece:
    """The piece that begins with `state` (3, m) and is, at its end, on the line that leaves `via` with `v1`.

    Args:
        state: x, v, a at the start.
        via: where the line begins. Shape (m,).
        via_clock: path time at which it does.
        v1: velocity on the line. Shape (m,).
        start, length: path time of the start, length of the transition; samples.
        period_s: sample period.
    """
    end = via + v1 * (start + length - via_clock) * period_s
    u0 = 2.0 * (end - state[0]) / (length * period_s) - v1
    return PathPiece(np.vstack((state, u0, v1, np.ones_like(v1))), start, length)


def rest(x: Floats, start: float) -> PathPiece:
    """Stand at `x` (m,)."""
    rows = np.zeros((6, x.size))
    rows[0], rows[5] = x, 1.0
    return PathPiece(rows, start, 1.0)
