"""The transition between two straight pieces of path (Paul 1981), in its velocity form.

A path heads for B with velocity v0 and leaves B with velocity v1. The transition lasts from Ta before to Ta after the
instant at which B would have been reached. With A the position where it begins, D = 2 Ta, h = t/D:

    q(t) = A + v0 t + (v1 - v0) D beta(h)

    quartic (Paul)      beta(h) = h^3 - h^4/2                    acceleration is zero at both ends
    zero jerk (ARCL)    beta(h) = 5/2 h^4 - 3 h^5 + h^6          acceleration and jerk are zero at both ends

beta(1) = 1/2 and beta'(1) = 1, so beyond the transition (h > 1) beta(h) = h - 1/2 continues it as the straight line
that leaves B with v1, and one formula covers a whole piece. beta' runs from 0 to 1 without overshoot: velocities stay
between v0 and v1, and the path inside the triangle of A, B and its own end.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final

from qrobot.realtime.jit import kernel


class Correction(IntEnum):
    """Polynomials that fade out a velocity which the transition did not expect (frames that move, changes of mode)."""

    CUBIC = 3  # Hayward & Paul 1986: c(h) = h (1 - h)^2; acceleration jumps at both ends
    SMOOTH = 5  # ours: c(h) = h (1 - h)^3 (1 + 3 h); it does not


class Blend(IntEnum):
    """Polynomials that join two pieces of path; the number is the degree."""

    QUARTIC = 4
    ZERO_JERK = 6


# Largest beta'': the peak acceleration of a transition is PEAK (v1 - v0) / D.
PEAK: Final[dict[Blend, float]] = {Blend.QUARTIC: 1.5, Blend.ZERO_JERK: 1.875}

_QUARTIC: Final = int(Blend.QUARTIC)
_CUBIC: Final = int(Correction.CUBIC)


@kernel
def beta(blend: int, h: float) -> tuple[float, float, float]:
    """(beta, beta', beta'') at `h` >= 0 for the degree `blend`."""
    if h >= 1.0:
        return h - 0.5, 1.0, 0.0
    if blend == _QUARTIC:
        return (1.0 - 0.5 * h) * h * h * h, (3.0 - 2.0 * h) * h * h, 6.0 * h * (1.0 - h)
    value = h * h * h * h * (2.5 + h * (-3.0 + h))
    slope = h * h * h * (10.0 + h * (-15.0 + 6.0 * h))
    return value, slope, 30.0 * h * h * (1.0 - h) * (1.0 - h)


@kernel
def absorb(h: float) -> tuple[float, float, float]:
    """(c, c', c'') of the polynomial that absorbs an acceleration left over at the start of a transition.

    Adding a0 D^2 c(h) starts with acceleration a0 and changes nothing else at either end:

        c(h) = h^2 (1 - h)^3 / 2        c(0) = c'(0) = 0, c''(0) = 1, c(1) = c'(1) = c''(1) = 0

    Ours, not historical: Hayward's cubic for interruptions leaves a jump of the acceleration.
    """
    if h >= 1.0:
        return 0.0, 0.0, 0.0
    g = 1.0 - h
    return 0.5 * h * h * g * g * g, 0.5 * h * g * g * (2.0 - 5.0 * h), g * (1.0 + h * (-8.0 + 10.0 * h))


@kernel
def fade(correction: int, h: float) -> tuple[float, float, float]:
    """(c, c', c'') of the polynomial that fades out an unexpected velocity, see `Correction`.

    Adding vx D c(h) starts faster by vx and changes position and velocity nowhere else at the ends:
    c(0) = c(1) = c'(1) = 0, c'(0) = 1. The cubic's largest value is 4/27, at h = 1/3.
    """
    if h >= 1.0:
        return 0.0, 0.0, 0.0
    g = 1.0 - h
    if correction == _CUBIC:
        return h * g * g, g * (1.0 - 3.0 * h), 6.0 * h - 4.0
    return h * g * g * g * (1.0 + 3.0 * h), g * g * (1.0 + 2.0 * h - 15.0 * h * h), h * g * (60.0 * h - 36.0)
