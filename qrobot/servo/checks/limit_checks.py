"""The safety gate: trusts neither the law, nor the sensors, nor whoever writes setpoints.

Every check answers with a fault code (0: all well), where it looks at joints with the first of them that fails too
(`NO_JOINT`: all well), and is written `not (x <= limit)`, so that NaN fails. No check
allocates, raises or prints. What follows from a code, `category_of` says.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from qrobot.faultcodes import NO_JOINT, FaultCode
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT, TORQUE_SETPOINT

NONE: Final = int(FaultCode.NONE)
VEL_LIMIT: Final = int(FaultCode.VEL_LIMIT)
RUNAWAY: Final = int(FaultCode.RUNAWAY)
FOLLOWING: Final = int(FaultCode.FOLLOWING)
JOINT_LIMIT: Final = int(FaultCode.JOINT_LIMIT)
LAW_NAN: Final = int(FaultCode.LAW_NAN)
BOARD_GONE: Final = int(FaultCode.BOARD_GONE)
SP_INVALID: Final = int(FaultCode.SP_INVALID)
SP_LIMIT: Final = int(FaultCode.SP_LIMIT)
SP_STEP: Final = int(FaultCode.SP_STEP)
START_POSE: Final = int(FaultCode.START_POSE)

# Past this share of the velocity limit a controlled stop is not trusted any more.
VELOCITY_CATEGORY_0: Final = 1.5


@lean_kernel
def check_velocity(v: Any, v_max: Any, factor: float) -> tuple[int, int]:
    """(code, joint): measured speed within `factor` times the limit; RUNAWAY beyond 1.5 times. Shapes (n,).

    A joint that runs away is told of before one that is only too fast, whichever comes first in the arm.
    """
    code, joint = NONE, NO_JOINT
    for j in range(v.size):
        if not abs(v[j]) <= VELOCITY_CATEGORY_0 * v_max[j]:
            return RUNAWAY, j
        if code == NONE and not abs(v[j]) <= factor * v_max[j]:
            code, joint = VEL_LIMIT, j
    return code, joint


@lean_kernel
def check_following(q_ref: Any, q: Any, allowed: Any, share: float = 1.0) -> tuple[int, int]:
    """(code, joint): the arm is where it was told to be, within `share` times `allowed` rad. Shapes (n,)."""
    for j in range(q.size):
        if not abs(q_ref[j] - q[j]) <= share * allowed[j]:
            return FOLLOWING, j
    return NONE, NO_JOINT


@lean_kernel
def check_range(q: Any, q_min: Any, q_max: Any, margin: Any) -> tuple[int, int]:
    """(code, joint): measured position inside its range widened by `margin`. Shapes (n,), rad or m."""
    for j in range(q.size):
        if not (q_min[j] - margin[j] <= q[j] <= q_max[j] + margin[j]):
            return JOINT_LIMIT, j
    return NONE, NO_JOINT


@lean_kernel
def check_image(unchanged: int, most: int, count: int, status: int) -> int:
    """The image is published, renewed at least every `most` cycles, and not the all-ones of an unplugged board.

    Cycles are counted, not time: a machine that stalls as a whole ages the image without the board being at fault.
    """
    if not count > 0:
        return BOARD_GONE
    if not unchanged <= most:
        return BOARD_GONE
    if status == 0xFFFF:
        return BOARD_GONE
    return NONE


@lean_kernel
def limit_torque(tau: Any, tau_max: Any) -> tuple[int, int, int]:
    """Clip `tau` in place to +-`tau_max`: (code, joint, number of joints clipped). Shapes (n,).

    What is no finite number becomes zero torque: an infinity is a division by zero, not a wish for full torque.
    """
    code, joint, clipped = NONE, NO_JOINT, 0
    for j in range(tau.size):
        if not abs(tau[j]) <= tau_max[j]:
            clipped += 1
            if not abs(tau[j]) < np.inf:
                tau[j] = 0.0
                code, joint = LAW_NAN, j
            elif tau[j] > 0.0:
                tau[j] = tau_max[j]
            else:
                tau[j] = -tau_max[j]
    return code, joint, clipped


@lean_kernel
def check_first_setpoint(setpoint: Any, modes: Any, q_ref: Any, tolerance: float) -> tuple[int, int]:
    """(code, joint): a stream begins where the reference stands, within `tolerance` rad. Shapes (n,)."""
    for j in range(setpoint.size):
        if modes[j] == POSITION_SETPOINT and not abs(setpoint[j] - q_ref[j]) <= tolerance:
            return START_POSE, j
        if not _is_mode(modes[j]):
            return SP_INVALID, j
    return NONE, NO_JOINT


@lean_kernel
def check_setpoint(
    setpoint: Any,
    modes: Any,
    knots: Any,
    q_min: Any,
    q_max: Any,
    v_max: Any,
    a_max: Any,
    tau_max: Any,
    period_s: float,
    slack: float,
) -> tuple[int, int]:
    """(code, joint): the next setpoint is of a known mode, finite, in range, and asks for no more than the joint has.

    Differences against the two newest knots give the velocity and acceleration asked for; sampling a smooth motion
    overshoots them slightly, which `v_max` and `a_max` have to allow for; a path that is led back after a lost
    frame bends more than its setpoints, which `slack` allows for. Shapes (n,), knots (4, n).
    """
    for j in range(setpoint.size):
        if modes[j] == POSITION_SETPOINT:
            step = setpoint[j] - knots[3, j]
            bend = step - (knots[3, j] - knots[2, j])
            if not abs(setpoint[j]) < np.inf:
                return SP_INVALID, j
            if not (q_min[j] <= setpoint[j] <= q_max[j]):
                return SP_LIMIT, j
            if not (abs(step) <= v_max[j] * period_s and abs(bend) <= slack * a_max[j] * period_s * period_s):
                return SP_STEP, j
        elif modes[j] == TORQUE_SETPOINT and not abs(setpoint[j]) <= tau_max[j]:
            return SP_LIMIT, j
        elif not _is_mode(modes[j]):
            return SP_INVALID, j
    return NONE, NO_JOINT


@lean_kernel
def _is_mode(mode: int) -> bool:
    """A mode that a setpoint can have: who wrote the words of the queue is not known here."""
    return mode in (0, POSITION_SETPOINT, TORQUE_SETPOINT)
