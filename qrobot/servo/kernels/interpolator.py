"""Smooth reference at the servo rate, out of setpoints 28 ms apart.

Four knots are the setpoints of four successive frames. A form of interpolation
(`servo.kernels.interpolation_polynomials`) is a table that makes of them a polynomial p(u), on which the reference runs
through one frame, 0 <= u <= 1. Forms that look ahead reach a setpoint later than those that do not: a setpoint is
always taken as knot 3, and the frame begins at an earlier one.

The phase u runs with the rate r = du/dt. A controlled stop lowers r smoothly to zero, so the arm stops *on the path*;
the path beyond the last setpoint goes on at its last velocity.

    v = p'(u) r        a = p''(u) r^2 + p'(u) dr/dt
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from qrobot.realtime.jit import lean_kernel
from qrobot.servo.kernels.interpolation_polynomials import BLEND, N_KNOTS, N_POWERS

# d/dx of the stop's smooth step 10 x^3 - 15 x^4 + 6 x^5 peaks at 15/8.
PEAK_SLOPE: Final = 1.875


@lean_kernel
def rest_at(knots: Any, rounding: Any, q: Any) -> None:
    """Fill all knots with `q`: the reference stands there. Shapes (4, n), (2, n) and (n,)."""
    for j in range(q.size):
        rounding[0, j] = rounding[1, j] = 0.0
        for i in range(N_KNOTS):
            knots[i, j] = q[j]


@lean_kernel
def shift_in(knots: Any, setpoint: Any) -> None:
    """Take the next setpoint as the newest knot. Shapes (4, n) and (n,)."""
    for j in range(setpoint.size):
        for i in range(N_KNOTS - 1):
            knots[i, j] = knots[i + 1, j]
        knots[N_KNOTS - 1, j] = setpoint[j]


@lean_kernel
def shift_extrapolated(knots: Any) -> None:
    """Go on at the last velocity in place of a missing setpoint. That a range may end is a matter of the stop."""
    for j in range(knots.shape[1]):
        following = 2.0 * knots[3, j] - knots[2, j]
        for i in range(N_KNOTS - 1):
            knots[i, j] = knots[i + 1, j]
        knots[3, j] = following


@lean_kernel
def line_through(knots: Any, rounding: Any, first_knot: int, j: int, phase: float, q: float, step: float) -> None:
    """Let the reference of joint `j` pass `q` at `phase` on a straight line of `step` per frame. Shapes (4, n), (2, n).

    `first_knot` is where the frames of the form in use begin (`Form.first_knot`).
    """
    for i in range(N_KNOTS):
        knots[i, j] = q + (i - first_knot - phase) * step
    rounding[0, j] = rounding[1, j] = 0.0


@lean_kernel
def step_weight(table: Any, step: int, phase: float) -> tuple[float, float, float]:
    """Share of one of the three steps between the knots in the reference, and its first two derivatives by phase.

    Horner's rule for a polynomial and its derivatives; `table` has shape (6, 4), its last column is the blend.
    """
    share, slope, half_curvature = 0.0, 0.0, 0.0
    for m in range(N_POWERS - 1, -1, -1):
        half_curvature = half_curvature * phase + slope
        slope = slope * phase + share
        share = share * phase + table[m, step]
    return share, slope, 2.0 * half_curvature


@lean_kernel
def reference(
    table: Any, knots: Any, rounding: Any, phase: float, rate: float, rate_slope: float, q: Any, v: Any, a: Any
) -> None:
    """Position, velocity and acceleration at `phase`.

    Args:
        table: coefficients of the form, see `Form.table`. Shape (6, 4).
        knots: the four setpoints around now. Shape (4, n), rad or m.
        rounding: how far beside knots 1 and 2 the reference passes. Shape (2, n), rad or m.
        phase: u, 0 where the frame begins and 1 where it ends.
        rate: r = du/dt, 1/s.
        rate_slope: dr/dt, 1/s^2.
        q, v, a: filled. Shape (n,), rad, rad/s, rad/s^2.
    """
    share1, slope1, curvature1 = step_weight(table, 0, phase)  # the same for every joint
    share2, slope2, curvature2 = step_weight(table, 1, phase)
    share3, slope3, curvature3 = step_weight(table, 2, phase)
    share4, slope4, curvature4 = step_weight(table, BLEND, phase)
    for j in range(q.size):
        d1, d2, d3 = knots[1, j] - knots[0, j], knots[2, j] - knots[1, j], knots[3, j] - knots[2, j]
        aside, d4 = rounding[0, j], rounding[1, j] - rounding[0, j]
        slope = slope1 * d1 + slope2 * d2 + slope3 * d3 + slope4 * d4
        curvature = curvature1 * d1 + curvature2 * d2 + curvature3 * d3 + curvature4 * d4
        q[j] = knots[0, j] + share1 * d1 + share2 * d2 + share3 * d3 + (aside + share4 * d4)
        v[j] = slope * rate
        a[j] = curvature * rate * rate + slope * rate_slope


@lean_kernel
def stop_duration(v: Any, a_stop: Any, shortest: float) -> float:
    """Seconds for a smooth stop from velocities `v` in which no joint decelerates harder than `a_stop`. Shapes (n,)."""
    duration = shortest
    for j in range(v.size):
        duration = max(duration, PEAK_SLOPE * abs(v[j]) / a_stop[j])
    return duration


@lean_kernel
def room_duration(q: Any, v: Any, q_min: Any, q_max: Any, overshoot_s: Any, margin: Any) -> float:
    """Seconds in which a stop from `v` has to be over for every joint to rest inside its range. Shapes (n,).

    A stop of T seconds covers v T / 2; infinite when all joints stand still. The arm goes further than its reference,
    by up to `overshoot_s` seconds of `v`: what half the `margin` of the range does not take of that is kept free, where
    there is room for it.
    """
    duration = np.inf
    for j in range(v.size):
        room = q_max[j] - q[j] if v[j] > 0.0 else q[j] - q_min[j]
        kept = max(0.0, overshoot_s[j] * abs(v[j]) - 0.5 * margin[j])
        if v[j] != 0.0:
            duration = min(duration, 2.0 * max(room - kept, 0.5 * room) / abs(v[j]))
    return duration


@lean_kernel
def stop_profile(elapsed: float, duration: float) -> tuple[float, float]:
    """Share of the full rate left `elapsed` seconds into a stop, and its slope in 1/s; (0, 0) once it is over."""
    x = elapsed / duration
    if not x < 1.0:
        return 0.0, 0.0
    left = 1.0 - x * x * x * (10.0 + x * (-15.0 + 6.0 * x))
    slope = -30.0 * x * x * (1.0 - x) * (1.0 - x) / duration
    return left, slope


@lean_kernel
def stop_way(elapsed: float, dt: float, duration: float) -> float:
    """Integral of `stop_profile` over the last `dt` of `elapsed` seconds, s; the rate is full before the stop began.

    However long a cycle takes, its stop goes as far as that of a punctual one.
    """
    begun = max(0.0, elapsed - dt)
    return max(0.0, dt - elapsed) + duration * (_stop_area(elapsed / duration) - _stop_area(begun / duration))


@lean_kernel
def _stop_area(x: float) -> float:
    """Integral of the share that is left, from 0 to `x` of the stop's duration."""
    x = min(x, 1.0)
    return x * (1.0 + x * x * x * (-2.5 + x * (3.0 - x)))
