"""Words to a page: the arms once, each sample in a binary frame, everything else as JSON when it changes.

A frame is little-endian: kind, arm, mode, hand (8 bits each), fault, event (16), joint of the event (16, signed),
speed override in thousandths (16), flags (32), time in s (64-bit float), then n 32-bit floats each of q, setpoint,
velocity and torque. The page does the forward kinematics itself, with the rows of `arm_facts`.
"""

from __future__ import annotations

import struct
from typing import Any, Final

import numpy as np

from qrobot.config import Robot
from qrobot.faultcodes import EXPLANATION
from qrobot.modecodes import Mode
from qrobot.model.arm_shape import arm_shape
from qrobot.units import NS_PER_S
from qrobot.wire import State
from qrobot.wire.vocabulary import LARGEST_OVERRIDE, RobotFlag

STATE_FRAME: Final = 1
HEAD: Final = struct.Struct("<BBBBHHhHId")
THOUSAND: Final = 1000


def state_frame(arm: int, state: State) -> bytes:
    """A sample of arm number `arm` (from 0) as bytes."""
    robot = state.robot
    override = robot.override if 0.0 <= robot.override <= LARGEST_OVERRIDE else 1.0  # NaN, and what is beyond
    joint = max(-1, min(robot.event_joint, 0x7FFF))
    flags = robot.flags | (RobotFlag.PATH_WAITS if state.path_waits else 0)
    head = HEAD.pack(
        STATE_FRAME, arm, robot.mode & 0xFF, robot.hand & 0xFF, robot.fault & 0xFFFF, robot.event & 0xFFFF, joint,
        round(override * THOUSAND), flags & 0xFFFFFFFF, robot.t_ns / NS_PER_S,
    )  # fmt: skip
    return head + np.array([*robot.q, *robot.q_setpoint, *robot.v, *robot.tau], dtype="<f4").tobytes()


def arm_facts(name: str, robot: Robot, tool_m: tuple[float, float, float]) -> dict[str, Any]:
    """Facts of an arm that do not change: joints, limits, rows of its table, the cylinders it is drawn by. SI units."""
    geometry, limits = robot.geometry, robot.limits
    return {
        "name": name,
        "robot": robot.name,
        "about": robot.about,
        "joints": list(robot.joint_names),
        "prismatic": robot.prismatic.tolist(),
        "dh": np.column_stack([geometry.alpha_rad, geometry.a_m, geometry.d_m, geometry.theta_rad]).tolist(),
        "base_height": geometry.base_height_m,
        "tip": [tool_m[0], tool_m[1], tool_m[2] + geometry.flange_m],
        "q_min": limits.q_min.tolist(),
        "q_max": limits.q_max.tolist(),
        "v_max": limits.v_max.tolist(),
        "tau_max": robot.guard.tau_max.tolist(),
        "poses": {pose: q.tolist() for pose, q in robot.poses.items()},
        "shape": [
            {"frame": part.frame, "T": part.T.ravel().tolist(), "radius": part.radius, "length": part.length,
             "joint": part.is_joint}
            for part in arm_shape(robot, tool_m)
        ],
    }  # fmt: skip


def vocabulary() -> dict[str, Any]:
    """Names of modes, and of each code its name, what happened and what to do."""
    return {
        "modes": {int(mode): mode.name for mode in Mode},
        "codes": {int(code): [code.name, what, remedy] for code, (what, remedy) in EXPLANATION.items()},
    }
