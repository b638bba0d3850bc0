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

Several losses, each of which bends the path before it is back, add up: where they would lead it farther aside than one
can, and than the arm may lag behind its setpoints anyway (`too_far_aside`), the arm has to stop. So it has where the
path would leave the range of a joint: what goes straight on, or is led aside, turns back later than its setpoints
(`turns_outside`). That a path which bends is faster between its setpoints than its steps is a matter of
`servo.kernels.rounding`.
"""

from __future__ import annotations

from typing import Any, Final

from qrobot.faultcodes import NO_JOINT
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT

BEND_SLACK: Final = 1.5
PULL: Final = 0.1  # of a_max T^2, from frame to frame [A]
NEGLIGIBLE: Final = 1e-9  # rad or m aside: what rounding makes of a straight line
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
    """Move the next setpoints to where the path leads back to them; True when it may bend more than they do there.

    So it may at the one behind, where the way back has ended and the path goes on as its setpoints do.

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
        elif bridged != 0 or aside[j] != 0.0:
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
            led = True
    return led


@lean_kernel
def _pull(aside: float, step: float, longest_step: float, longest_pull: float) -> float:
    """Part of `aside` that the next setpoint gives up, where a `step` leads to it as far aside as the one before."""
    if aside > 0.0:
        return max(0.0, min(aside, longest_pull, longest_step + step))
    return min(0.0, max(aside, -longest_pull, step - longest_step))


@lean_kernel
def too_far_aside(aside: Any, allowed: Any, a_max: Any, period_s: float) -> int:
    """First joint led farther aside than `allowed` and than one lost frame explains, or `NO_JOINT`. Shapes (n,)."""
    for j in range(aside.size):
        if not abs(aside[j]) <= max(allowed[j], BEND_SLACK * a_max[j] * period_s * period_s):
            return j
    return NO_JOINT


@lean_kernel
def turns_outside(setpoint: Any, modes: Any, knots: Any, q_min: Any, q_max: Any, margin: Any) -> int:
    """First joint whose path turns back on the way to the next setpoint farther beyond its range than `margin`.

    At the newest knot k it has the speed w per frame of the setpoints around it, and their bend b: it turns round
    w^2 / 2 b beyond k, before the next one where w is smaller than b. Shapes (n,), knots (4, n), rad or m; `NO_JOINT`
    for none.
    """
    for j in range(setpoint.size):
        w, b = 0.5 * (setpoint[j] - knots[2, j]), setpoint[j] - 2.0 * knots[3, j] + knots[2, j]
        if modes[j] == POSITION_SETPOINT and w * b < 0.0 and abs(w) < abs(b):
            farthest = knots[3, j] - 0.5 * w * w / b
            if not q_min[j] - margin[j] <= farthest <= q_max[j] + margin[j]:
                return j
    return NO_JOINT
