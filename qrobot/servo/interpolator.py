"""From setpoints 28 ms apart to a smooth reference at the servo rate.

Four knots are the setpoints of four successive frames. The reference runs from knot 1 to knot 2 on a quintic
polynomial whose velocity and acceleration at the knots are central differences, so it passes through every setpoint
with continuous acceleration. The price is look-ahead: a setpoint is reached two frames after it was taken from the
queue.

    p(u) = k1 + v1 u + a1/2 u^2 + c3 u^3 + c4 u^4 + c5 u^5          0 <= u <= 1, in frames
    v_i = (k_{i+1} - k_{i-1}) / 2        a_i = k_{i+1} - 2 k_i + k_{i-1}

The phase u runs with the rate r = du/dt. A controlled stop lowers r smoothly to zero, so the arm stops *on the path*;
the path beyond the last setpoint goes on at its last velocity.

    v = p'(u) r        a = p''(u) r^2 + p'(u) dr/dt
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from qrobot.realtime.jit import lean_kernel

N_KNOTS: Final = 4
LOOK_AHEAD_FRAMES: Final = 2.0  # from taking a setpoint to reaching it

# d/dx of the stop's smooth step 10 x^3 - 15 x^4 + 6 x^5 peaks at 15/8.
PEAK_SLOPE: Final = 1.875


@lean_kernel
def rest_at(knots: Any, q: Any) -> None:
    """Fill all knots with `q`: the reference stands there. Shapes (4, n) and (n,)."""
    for i in range(N_KNOTS):
        for j in range(q.size):
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
    """In place of a missing setpoint: go on at the last velocity. That a range may end is a matter of the stop."""
    for j in range(knots.shape[1]):
        following = 2.0 * knots[3, j] - knots[2, j]
        for i in range(N_KNOTS - 1):
            knots[i, j] = knots[i + 1, j]
        knots[3, j] = following


@lean_kernel
def line_through(knots: Any, j: int, phase: float, q: float, step: float) -> None:
    """Let the reference of joint `j` pass `q` at `phase` on a straight line of `step` per frame. Shape (4, n)."""
    for i in range(N_KNOTS):
        knots[i, j] = q + (i - 1 - phase) * step


@lean_kernel
def reference(knots: Any, phase: float, rate: float, rate_slope: float, q: Any, v: Any, a: Any) -> None:
    """Position, velocity and acceleration at `phase`.

    Args:
        knots: the four setpoints around now. Shape (4, n), rad or m.
        phase: u, 0 at knot 1 and 1 at knot 2.
        rate: r = du/dt, 1/s.
        rate_slope: dr/dt, 1/s^2.
        q, v, a: filled. Shape (n,), rad, rad/s, rad/s^2.
    """
    u = phase
    for j in range(q.size):
        k0, k1, k2, k3 = knots[0, j], knots[1, j], knots[2, j], knots[3, j]
        distance = k2 - k1
        v1, v2 = 0.5 * (k2 - k0), 0.5 * (k3 - k1)
        a1, a2 = k2 - 2.0 * k1 + k0, k3 - 2.0 * k2 + k1
        c3 = 10.0 * distance - 6.0 * v1 - 4.0 * v2 - 1.5 * a1 + 0.5 * a2
        c4 = -15.0 * distance + 8.0 * v1 + 7.0 * v2 + 1.5 * a1 - a2
        c5 = 6.0 * distance - 3.0 * v1 - 3.0 * v2 - 0.5 * a1 + 0.5 * a2
        slope = v1 + u * (a1 + u * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5)))
        curvature = a1 + u * (6.0 * c3 + u * (12.0 * c4 + u * 20.0 * c5))
        q[j] = k1 + u * (v1 + u * (0.5 * a1 + u * (c3 + u * (c4 + u * c5))))
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
def room_duration(q: Any, v: Any, q_min: Any, q_max: Any) -> float:
    """Seconds in which a stop from `v` has to be over for every joint to rest inside its range. Shapes (n,).

    A stop of T seconds covers v T / 2; infinite when all joints stand still.
    """
    duration = np.inf
    for j in range(v.size):
        room = q_max[j] - q[j] if v[j] > 0.0 else q[j] - q_min[j]
        if v[j] != 0.0:
            duration = min(duration, 2.0 * room / abs(v[j]))
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
