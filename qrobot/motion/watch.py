"""The last look at a setpoint of which nobody could know beforehand that it keeps the limits: the goal may move."""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.errors import JointLimit, MotionError, Singular, Unreachable
from qrobot.motion.blend import PEAK, Blend
from qrobot.motion.events import Termination
from qrobot.motion.limits import Floats, MotionLimits
from qrobot.motion.trail import Samples, motion_of

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


def judge(state: Floats, limits: MotionLimits, blend: Blend) -> Termination:
    """What is wrong with a setpoint of `state` (3, n: q, v, a): NONE, JOINT_LIMIT or TOO_FAST.

    A joint limit is a limit from which the arm could no longer be stopped: before it is passed.
    """
    q, v, a = state
    if not (np.abs(v) <= _SLACK * limits.v_max).all() or not (np.abs(a) <= _SLACK * limits.a_max).all():
        return Termination.TOO_FAST
    stopped = q + v * (0.5 * halting_s(v, limits, blend))
    if not ((limits.q_min <= stopped) & (stopped <= limits.q_max)).all():
        return Termination.JOINT_LIMIT
    return Termination.NONE


def judge_next(points: Samples, period_s: float, limits: MotionLimits, blend: Blend) -> Termination:
    """`judge` of the newest of some setpoints; a joint that could go on a whole turn away only is at its limit."""
    if len(points) > 1 and np.abs(points[-1][1] - points[-2][1]).max() > np.pi:
        return Termination.JOINT_LIMIT
    return judge(motion_of(points, period_s), limits, blend)
