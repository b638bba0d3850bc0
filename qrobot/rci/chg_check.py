"""Judgement of what a control function asks for: the check behind control1 in Figure 4 of the paper."""

from __future__ import annotations

from numbers import Integral
from typing import NamedTuple

import numpy as np

from qrobot.config.outputs import ALL_OUTPUTS
from qrobot.errors import MotionError
from qrobot.rci.arguments import shown
from qrobot.rci.blackboard import Chg
from qrobot.rci.fenced_setpoints import check_setpoints
from qrobot.rci.robot_data import RobotData
from qrobot.wire import Command, JointMode
from qrobot.wire.vocabulary import Hand


class Asked(NamedTuple):
    """Modes and setpoints of one command, which nobody can change in place."""

    modes: tuple[int, ...]
    setpoints: tuple[float, ...]


def check_chg(name: str, chg: Chg, data: RobotData, before: Asked | Command, period_s: float) -> Asked:
    """Judge what a control function asks for, `before` being what went out at the sample before; returns its copy.

    Raises:
        MotionError: no setpoints of this arm, no such hand or outputs, a torque beyond its limit, a number that is
            none, or a joint that would be too fast.
        JointLimit: a position outside the range. FenceCrossed: one from which the arm could not stop before a fence.
    """
    whole = all(isinstance(number, Integral) for number in (chg.hand, chg.outputs))
    if not whole or chg.hand not in list(Hand) or not 0 <= chg.outputs <= ALL_OUTPUTS:
        raise MotionError(
            f"task {name}: hand {shown(chg.hand)} and outputs {shown(chg.outputs)}, 0 to 2 and 16 bits exist"
        )
    modes, setpoints = np.array(chg.modes), np.array(chg.setpoints, dtype=np.float64)  # copies, which are judged
    if (
        modes.dtype.kind not in "iu"
        or modes.shape != (data.n,)
        or setpoints.shape != (data.n,)
        or not np.isin(modes, list(JointMode)).all()
    ):
        raise MotionError(f"task {name}: chg needs a mode and a setpoint for each of {data.n} joints")
    positions, torques = modes == JointMode.POSITION, modes == JointMode.TORQUE
    data.limits.check_position(np.where(positions, setpoints, data.limits.q_min), f"task {name}")
    excess = torques & ~(np.abs(setpoints) <= data.tau_max)
    if excess.any():
        j = int(excess.argmax())
        raise MotionError(f"task {name}: {setpoints[j]:.4g} on joint {j + 1}, at most {data.tau_max[j]:.4g} allowed")
    if not np.isfinite(setpoints).all():
        raise MotionError(f"task {name}: setpoints {setpoints.tolist()} are no finite numbers")
    went_on = positions & (np.asarray(before.modes) == JointMode.POSITION)
    step = np.where(went_on, setpoints - np.asarray(before.setpoints), 0.0)
    data.limits.check_velocity(step / period_s, f"task {name}", "make smaller steps from sample to sample")
    if data.fences is not None and went_on.all():
        stop = data.limits.a_stop
        check_setpoints(data.fences, f"task {name}", setpoints - step, setpoints, stop, period_s)
    return Asked(tuple(modes.tolist()), tuple(setpoints.tolist()))
