"""Speed of the tool's tip, from joint positions and velocities, and the check of it."""

from __future__ import annotations

import math
from typing import Any, Final

from qrobot.arrays import Floats
from qrobot.faultcodes import FaultCode
from qrobot.model.chain import ChainParams, link_origin, link_turn, to_link
from qrobot.model.vec3 import Vec, add, cross
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT

T1_LIMIT: Final = int(FaultCode.T1_LIMIT)


@lean_kernel
def tip_speed(q: Floats, v: Floats, chain: ChainParams, tip: Vec) -> float:
    """Speed of a point fixed in the last link, at `tip` of its frame, m/s. `q` and `v` have shape (n,)."""
    omega, velocity = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(q.size):
        turn, origin = link_turn(q, chain, i), link_origin(q, chain, i)
        velocity = to_link(turn, add(velocity, cross(omega, origin)))
        omega = to_link(turn, omega)
        if chain.prismatic[i]:
            velocity = add(velocity, (0.0, 0.0, v[i]))
        else:
            omega = add(omega, (0.0, 0.0, v[i]))
    x, y, z = add(velocity, cross(omega, tip))
    return math.sqrt(x * x + y * y + z * z)


@lean_kernel
def check_tip_speed(speed: float, limit: float) -> int:
    """The tool may not be faster than `limit`, m/s."""
    return 0 if speed <= limit else T1_LIMIT


@lean_kernel
def check_tip_step(
    setpoint: Any, modes: Any, knots: Any, period_s: float, chain: ChainParams, tip: Any, limit: float, v: Any
) -> int:
    """A new setpoint may not ask more than `limit` (m/s, 0 for none) of the tip, from the newest of the knots (4, n).

    Joints that are driven by torque count as at rest here. `v` is filled. Shapes (n,).
    """
    if limit <= 0.0:
        return 0
    for j in range(v.size):
        v[j] = (setpoint[j] - knots[3, j]) / period_s if modes[j] == POSITION_SETPOINT else 0.0
    return check_tip_speed(tip_speed(knots[3], v, chain, (tip[0], tip[1], tip[2])), limit)
