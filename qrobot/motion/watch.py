"""The last look at a setpoint of which nobody could know beforehand that it keeps the limits: the goal may move."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from qrobot.errors import JointLimit, MotionError, Singular, Unreachable
from qrobot.motion.blend import PEAK, Blend
from qrobot.motion.events import Termination
from qrobot.motion.limits import Floats, MotionLimits
from qrobot.motion.trail import Samples, parabola, rows_of, spacing
from qrobot.realtime.jit import lean_kernel

NONE: Final = int(Termination.NONE)
JOINT_LIMIT: Final = int(Termination.JOINT_LIMIT)
TOO_FAST: Final = int(Termination.TOO_FAST)

# Speed and acceleration are differences of samples, which exceed what was planned a little where it changes.
_SLACK: Final = 1.05

SHORTEST_HALT_S: Final = 0.1  # however slow: the acceleration must not come and go within a sample

_REASONS: Final[dict[type[MotionError], Termination]] = {
    JointLimit: Termination.JOINT_LIMIT,
    Unreachable: Termination.UNREACHABLE,
    Singular: Termination.SINGULAR,
}


def reason(error: MotionError) -> Termination:
    """The code for what the kinematics raised."""
    return _REASONS.get(type(error), Termination.UNREACHABLE)


def halting_s(v: Floats, limits: MotionLimits, blend: Blend) -> float:
    """Time in which joints of velocity `v` (n,) come to rest together, the busiest with its a_stop."""
    return max(SHORTEST_HALT_S, float((np.abs(v) / limits.a_stop).max()) * PEAK[blend])


def judge_next(points: Samples, period_s: float, limits: MotionLimits, blend: Blend) -> Termination:
    """What is wrong with the newest of some setpoints: NONE, JOINT_LIMIT or TOO_FAST.

    A joint limit is a limit from which the arm could no longer be stopped: before it is passed. A joint that could go
    on a whole turn away only is at its limit, too.
    """
    rows, near_s, far_s = rows_of(points, period_s)
    return Termination(judge_rows(rows, near_s, far_s, limits.table, PEAK[blend]))


@lean_kernel
def judge_rows(rows: Floats, near_s: float, far_s: float, limits: Floats, peak: float) -> int:
    """`judge_next` of what `rows_of` gives, with `MotionLimits.table` and the PEAK of the transitions."""
    between = spacing(near_s, far_s)
    halt_s, jumps, too_fast = SHORTEST_HALT_S, False, False
    for j in range(rows.shape[1]):
        v, a = parabola(rows[0, j], rows[1, j], rows[2, j], between)
        jumps = jumps | (abs(rows[0, j] - rows[1, j]) > math.pi)
        too_fast = too_fast | (not abs(v) <= _SLACK * limits[2, j]) | (not abs(a) <= _SLACK * limits[3, j])
        halt_s = max(halt_s, peak * abs(v) / limits[4, j])
    if jumps:
        return JOINT_LIMIT
    if too_fast:
        return TOO_FAST
    for j in range(rows.shape[1]):
        v, _ = parabola(rows[0, j], rows[1, j], rows[2, j], between)
        if not limits[0, j] <= rows[0, j] + 0.5 * halt_s * v <= limits[1, j]:
            return JOINT_LIMIT
    return NONE
