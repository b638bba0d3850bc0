"""The last look at a setpoint of which nobody could know beforehand that it keeps the limits: the goal may move."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import FenceCrossed, JointLimit, MotionError, Singular, Unreachable
from qrobot.motion.event import Termination
from qrobot.motion.path.blend import PEAK, Blend
from qrobot.motion.path.setpoint_history import History, parabola, rows_of, spacing
from qrobot.motion.planning.joint_stop import LIFT, SHORTEST_STOP_S, can_stop, stopping_s
from qrobot.motion.world.limits import MotionLimits
from qrobot.realtime.jit import lean_kernel

NONE: Final = int(Termination.NONE)
JOINT_LIMIT: Final = int(Termination.JOINT_LIMIT)
TOO_FAST: Final = int(Termination.TOO_FAST)

_REASONS: Final[dict[type[MotionError], Termination]] = {
    JointLimit: Termination.JOINT_LIMIT,
    Unreachable: Termination.UNREACHABLE,
    Singular: Termination.SINGULAR,
    FenceCrossed: Termination.FENCE,
}


def reason(error: MotionError) -> Termination:
    """The code for what the kinematics raised."""
    return _REASONS.get(type(error), Termination.UNREACHABLE)


def judge_next(points: History, period_s: float, limits: MotionLimits, blend: Blend) -> Termination:
    """Judge the newest of some setpoints: NONE, JOINT_LIMIT or TOO_FAST.

    Right is one from which the arm can be halted (joint_stop.py) without passing a limit of position, speed or
    acceleration. A joint that could go on a whole turn away only is at its limit, too. One that begins beyond its
    limit, as a wrist without power may, comes back or stays where it is.
    """
    rows, near_s, far_s = rows_of(points, period_s)
    return Termination(judge_rows(rows, near_s, far_s, limits.table, PEAK[blend]))


def judge_row(joints: Floats, step_s: float, limits: MotionLimits, blend: Blend) -> Termination:
    """Judge joint positions (k, n) that are `step_s` apart in time, as `judge_next` judges one after the other."""
    newest_first = np.ascontiguousarray(joints[::-1])
    return Termination(judge_threes(newest_first, step_s, limits.table, PEAK[blend]))


def joint_at_limit(points: History, period_s: float, limits: MotionLimits, blend: Blend) -> int:
    """The joint, from 0, for which `judge_next` gives JOINT_LIMIT: it jumps, or is led farthest beyond its range.

    One that began beyond it, and goes no farther, is not meant.
    """
    rows, near_s, far_s = rows_of(points, period_s)
    if (jumps := np.abs(rows[0] - rows[1]) > math.pi).any():
        return int(jumps.argmax())
    between, (_, _, _, a_max, stop) = spacing(near_s, far_s), limits.table
    v, a = np.array([parabola(now, before, earlier, between) for now, before, earlier in rows.T]).T
    stop_s = max(SHORTEST_STOP_S, *map(stopping_s, v, a, a_max, stop, [PEAK[blend]] * len(v)))
    ways = 0.5 * stop_s * v, LIFT * SHORTEST_STOP_S**2 * a
    low, high = (rows[0] + sum(turned(way, 0.0) for way in ways) for turned in (np.minimum, np.maximum))
    q_min, q_max = np.minimum(limits.q_min, rows[1]), np.maximum(limits.q_max, rows[1])
    return int(np.maximum(q_min - low, high - q_max).argmax())


@lean_kernel
def judge_rows(rows: Floats, near_s: float, far_s: float, limits: Floats, peak: float) -> int:
    """`judge_next` of what `rows_of` gives, with `MotionLimits.table` and the PEAK of the transitions."""
    between = spacing(near_s, far_s)
    stop_s, jumps, too_fast = SHORTEST_STOP_S, False, False
    for j in range(rows.shape[1]):
        v, a = parabola(rows[0, j], rows[1, j], rows[2, j], between)
        jumps = jumps | (abs(rows[0, j] - rows[1, j]) > math.pi)
        too_fast = too_fast | (not can_stop(v, a, limits[2, j], limits[3, j]))
        stop_s = max(stop_s, stopping_s(v, a, limits[3, j], limits[4, j], peak))
    if jumps:
        return JOINT_LIMIT
    if too_fast:
        return TOO_FAST
    for j in range(rows.shape[1]):
        v, a = parabola(rows[0, j], rows[1, j], rows[2, j], between)
        run_out, lift = 0.5 * stop_s * v, LIFT * SHORTEST_STOP_S * SHORTEST_STOP_S * a
        low, high = (
            rows[0, j] + min(run_out, 0.0) + min(lift, 0.0),
            rows[0, j] + max(run_out, 0.0) + max(lift, 0.0),
        )
        if not (min(limits[0, j], rows[1, j]) <= low and high <= max(limits[1, j], rows[1, j])):
            return JOINT_LIMIT
    return NONE


@lean_kernel
def judge_threes(rows: Floats, step_s: float, limits: Floats, peak: float) -> int:
    """`judge_rows` of all three in a row (k, n), newest first, `step_s` apart: NONE when all are right."""
    for i in range(rows.shape[0] - 2):
        code = judge_rows(rows[i : i + 3], step_s, step_s, limits, peak)
        if code != NONE:
            return code
    return NONE
