"""Leading the path back to its setpoints after a lost frame, with no more speed and acceleration than the arm has.

Where a frame is missing the path goes on at constant velocity. The true motion has meanwhile bent away by b1, then by
b2, so that the next setpoint shows a bend of D = 2 b1 + b2, up to three times what the motion itself has. Taken as it
is, it asks for three times the acceleration, and for a step that may exceed the speed of the joint. Instead

    the next setpoint is taken D/2 before its place   its step is the mean of the two true ones, its bend D/2
    the one after it as far from its place            its step is the true one, its bend b3 + b2/2
    each that follows a little nearer to its place    by `PULL` a_max T^2, while that much speed stays in reserve

With |b| <= a_max T^2 no bend exceeds 1.5 a_max T^2, or `BEND_SLACK` times the most that a stream may ask for. The price
is a path that runs up to 1.5 a_max T^2 beside its setpoints and is back within 15 frames, or once the joint is slow
enough for that.

Sometimes no way leads back (`no_way_back`), and the arm has to stop. Several losses, each of which bends the path
before it is back, would add up. And between setpoints a path that bends is faster than its steps: with long frames,
near the greatest speed of a joint, by more than the joint has.
"""

from __future__ import annotations

from typing import Any, Final

from qrobot.faultcodes import NO_JOINT
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.kernels.interpolator import step_weight
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT

BEND_SLACK: Final = 1.5
PULL: Final = 0.1  # of a_max T^2, from frame to frame [A]
NEGLIGIBLE: Final = 1e-9  # rad or m aside: what rounding makes of a straight line
LOOKS: Final = 8  # parts of a frame at whose ends its speed is looked at
SHARE: Final = 0.5  # of D; neither more nor less keeps all bends at 1.5 a_max T^2


@lean_kernel
def lead_back(
    setpoint: Any,
    modes: Any,
    knots: Any,
    aside: Any,
    bridged: int,
    q_min: Any,
    q_max: Any,
    v_max: Any,
    a_max: Any,
    period_s: float,
) -> bool:
    """Move the next setpoints to where the path leads back to them; True when one of them is led.

    A setpoint outside the range stays as it is, for the check of setpoints to refuse; no other is led out of the range.

    Args:
        setpoint: the next one, as it was sent; changed where it is led. Shape (n,), rad or m.
        modes: what each joint does with it. Shape (n,).
        knots: the four newest knots. Shape (4, n).
        aside: from the place of the newest setpoint to where it was taken; renewed. Shape (n,), rad or m.
        bridged: the knot that stands for a missing frame: 1 the newest, 2 the one before, 0 neither.
        q_min, q_max: range. Shape (n,), rad or m.
        v_max, a_max: limits. Shape (n,), rad/s and rad/s^2, or m/s and m/s^2.
        period_s: T.
    """
    led = False
    for j in range(setpoint.size):
        place = setpoint[j]
        if modes[j] != POSITION_SETPOINT or not q_min[j] <= place <= q_max[j]:
            aside[j] = 0.0
        elif bridged == 1 or aside[j] != 0.0:
            taken = place + aside[j]
            step = taken - knots[3, j]
            if bridged == 1:
                taken -= SHARE * (step - (knots[3, j] - knots[2, j]))
            elif bridged == 0:
                pull = PULL * a_max[j] * period_s * period_s
                taken -= _pull(aside[j], step, v_max[j] * period_s - pull, pull)
            taken = min(max(taken, q_min[j]), q_max[j])
            aside[j] = 0.0 if abs(taken - place) <= NEGLIGIBLE else taken - place
            setpoint[j] = place + aside[j]
            led = led or aside[j] != 0.0
    return led


@lean_kernel
def _pull(aside: float, step: float, longest_step: float, longest_pull: float) -> float:
    """Part of `aside` that the next setpoint gives up, where a `step` leads to it as far aside as the one before."""
    if aside > 0.0:
        return max(0.0, min(aside, longest_pull, longest_step + step))
    return min(0.0, max(aside, -longest_pull, step - longest_step))


@lean_kernel
def no_way_back(
    table: Any, setpoint: Any, modes: Any, knots: Any, aside: Any, v_max: Any, a_max: Any, period_s: float
) -> int:
    """First joint that is led farther aside than one lost frame explains, or faster than v_max, or `NO_JOINT`.

    Args:
        table: coefficients of the form, see `Form.table`. Shape (6, 3).
        setpoint, modes: the next one, led back already. Shapes (n,).
        knots: the four newest knots before it. Shape (4, n).
        aside: how far it is led aside. Shape (n,).
        v_max, a_max: limits. Shape (n,).
        period_s: T.
    """
    for j in range(setpoint.size):
        if not abs(aside[j]) <= BEND_SLACK * a_max[j] * period_s * period_s:
            return j
    for i in range(LOOKS + 1):
        _, slope1, _ = step_weight(table, 0, i / LOOKS)
        _, slope2, _ = step_weight(table, 1, i / LOOKS)
        _, slope3, _ = step_weight(table, 2, i / LOOKS)
        for j in range(setpoint.size):
            d1, d2, d3 = knots[2, j] - knots[1, j], knots[3, j] - knots[2, j], setpoint[j] - knots[3, j]
            slope = slope1 * d1 + slope2 * d2 + slope3 * d3
            if modes[j] == POSITION_SETPOINT and not abs(slope) <= v_max[j] * period_s:
                return j
    return NO_JOINT
