"""Rounding the corners of a path whose reference would otherwise be faster between setpoints than the joint may be.

A smooth reference that passes through every setpoint is faster than the steps between them, wherever they change: the
form has to make up for the time it takes to get faster. Of setpoints 0, 0, 0, d, 2 d the quintic makes 1.2 d per frame,
of turns between d and -d up to 1.75 d. A stream that is as fast as the joint may be then ends in a fault.

The uniform cubic B-spline is never faster than its steps: its velocity is a mean of them. It passes beside knot k_i, by
a sixth of the bend there, and has the velocity and acceleration there that the quintic has:

    k_i + b_i/6          (k_{i+1} - k_{i-1})/2          b_i = k_{i+1} - 2 k_i + k_{i-1}

So the two are ends of one family: a reference that passes beside knot k_i by e_i = r_i b_i/6 is as smooth as the form
for any 0 <= r_i <= 1. Here each r_i is chosen when the knot after k_i is known, as small as it can be: 0, through the
setpoint, unless the frame before it or the one behind it could then be faster than the joint may be, or than the
fastest of the three steps. With r_i = 1 neither is, whatever comes, as long as r_{i-1} was chosen so. The cubic of
central differences has the velocities of the B-spline as well, and the same is true of it.

    the frame to k_i:    slope of the form + b'(u) (e_i - e_{i-1})
    the frame from k_i:  slope of the B-spline + b'(u) (b_i/6 - e_i)        with r_{i+1} = 1 and the fastest next step
"""

from __future__ import annotations

from typing import Any, Final

from qrobot.realtime.jit import lean_kernel
from qrobot.servo.kernels.interpolation_polynomials import BLEND
from qrobot.servo.kernels.interpolator import step_weight

LOOKS: Final = 16  # parts of a frame between which its speed is looked at
SLOW: Final = 0.5  # of the limit: no form makes more than twice its fastest step


@lean_kernel
def round_corner(table: Any, knots: Any, rounding: Any, v_max: Any, period_s: float) -> None:
    """Choose how far beside knot 2 the reference passes, after knot 3 was taken.

    Args:
        table: coefficients of the form, see `Form.table`. Shape (6, 4).
        knots: the four newest. Shape (4, n), rad or m.
        rounding: how far beside knots 1 and 2 the reference passes; moves on by one knot. Shape (2, n), rad or m.
        v_max: limits. Shape (n,), rad/s or m/s.
        period_s: of a frame.
    """
    for j in range(v_max.size):
        d1, d2, d3 = knots[1, j] - knots[0, j], knots[2, j] - knots[1, j], knots[3, j] - knots[2, j]
        beside, fastest = rounding[1, j], max(abs(d1), abs(d2), abs(d3))
        limit = max(v_max[j] * period_s, fastest)
        rounding[0, j], rounding[1, j] = beside, 0.0
        if fastest > SLOW * limit or beside != 0.0:
            sign = 1.0 if d3 >= d2 else -1.0
            rounding[1, j] = sign * _least_rounding(table, sign * d1, sign * d2, sign * d3, sign * beside, limit)


@lean_kernel
def _least_rounding(table: Any, d1: float, d2: float, d3: float, beside: float, limit: float) -> float:
    """e2 of knots whose last three steps are d1, d2 and d3 >= d2, beside the first of which the reference passes."""
    full = (d3 - d2) / 6.0
    least = 0.0
    for i in range(1, LOOKS):
        u = i / LOOKS
        _, slope1, _ = step_weight(table, 0, u)
        _, slope2, _ = step_weight(table, 1, u)
        _, slope3, _ = step_weight(table, 2, u)
        _, blend, _ = step_weight(table, BLEND, u)
        if blend > 0.0:
            before = slope1 * d1 + slope2 * d2 + slope3 * d3 - blend * beside
            behind = 0.5 * ((1.0 - u) * (1.0 - u) * d2 + (1.0 + 2.0 * u - 2.0 * u * u) * d3 + u * u * limit)
            least = max(least, (-limit - before) / blend, full - (limit - behind) / blend)
    return min(least, full)
