"""Stop of the joints from any state that a motion may have, wherever that is, within their limits.

Together, in D seconds, from position x0, velocity v and acceleration a; a fades out first, joint by joint in A seconds
(blend.py has beta and the polynomial c):

    x(t) = x0 + v t - v D beta(t/D) + a A^2 c(t/A)

While it fades, an acceleration along the velocity still adds at most BULGE A |a| to it, and one against it never more
than a. So the limits are kept when

    |v| + BULGE A |a| <= v_max                  which sets A
    PEAK |v| / D <= a_stop                      which set D
    PEAK |v| / D + SWING |a| <= a_max

What is beyond them is no state to go to: a setpoint from which no such halt is possible is never given out
(setpoint_check.py).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.motion.path.blend import PEAK, Blend
from qrobot.motion.world.limits import MotionLimits
from qrobot.realtime.jit import lean_kernel

SHORTEST_STOP_S: Final = 0.1  # [A] however slow: the acceleration must not come and go within a sample
BULGE: Final = 0.06779  # largest c': of the polynomial that absorbs an acceleration, at h = 0.155
SWING: Final = 0.37394  # largest -c'', at h = 0.36
LIFT: Final = 0.01728  # largest c, at h = 0.4
_LEAST_SHARE: Final = 0.01  # [A] of SHORTEST_STOP_S, in which an acceleration is given up at once
_ROUNDED: Final = 1.0 + 1e-9  # what was planned to be exactly at a limit may be there


@lean_kernel
def absorbing_s(v: float, a: float, v_max: float) -> float:
    """A: seconds in which the acceleration `a` of a joint may fade out while it moves with `v`."""
    if a * v <= 0.0:
        return SHORTEST_STOP_S
    longest = (v_max - abs(v)) / (BULGE * abs(a))
    return min(SHORTEST_STOP_S, max(longest, _LEAST_SHARE * SHORTEST_STOP_S))


@lean_kernel
def stopping_s(v: float, a: float, a_max: float, a_stop: float, peak: float) -> float:
    """D: seconds in which a joint of this state can come to rest; `peak` is PEAK of the blend."""
    allowed = min(a_stop, a_max - SWING * min(abs(a), a_max))
    return max(SHORTEST_STOP_S, peak * abs(v) / allowed)


@lean_kernel
def can_stop(v: float, a: float, v_max: float, a_max: float) -> bool:
    """True when a joint of this state can be brought to rest within its limits, and without a jolt.

    The acceleration must be allowed to fade out over a time in proportion to it.
    """
    reserve = BULGE * SHORTEST_STOP_S * a * a / a_max if a * v > 0.0 else 0.0
    return abs(v) + reserve <= v_max * _ROUNDED and abs(a) <= a_max * _ROUNDED


def joint_stop_s(state: Floats, limits: MotionLimits, blend: Blend) -> tuple[float, Floats]:
    """D, and A of each joint (n,), for `state` (3, n: q, v, a)."""
    peak, longest_s, fading_s = PEAK[blend], SHORTEST_STOP_S, np.empty(limits.n)
    for j, (v, a) in enumerate(zip(state[1], state[2], strict=True)):
        longest_s = max(longest_s, stopping_s(v, a, limits.a_max[j], limits.a_stop[j], peak))
        fading_s[j] = absorbing_s(v, a, limits.v_max[j])
    return longest_s, fading_s


def all_can_stop(v: Floats, a: Floats, limits: MotionLimits) -> bool:
    """`can_stop` of every joint at each of some places. Shapes (k, n)."""
    reserve = np.where(a * v > 0.0, BULGE * SHORTEST_STOP_S * a * a / limits.a_max, 0.0)
    inside = np.abs(v) + reserve <= limits.v_max * _ROUNDED
    return bool((inside & (np.abs(a) <= limits.a_max * _ROUNDED)).all())


def all_can_stop_along(joints: Floats, step_s: float, limits: MotionLimits) -> bool:
    """`all_can_stop` at joint positions (k, n) that are `step_s` apart in time, of which differences tell the rest."""
    places = len(joints)
    v = np.array(np.gradient(joints, step_s, axis=0, edge_order=2))
    a = np.diff(joints, 2, axis=0)[[0, *range(places - 2), -1]] / step_s**2
    return all_can_stop(v, a, limits)
