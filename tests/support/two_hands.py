"""Two PUMAs face to face, a metre apart, with a hand each at an object between them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import load_robot
from qrobot.model.arm import Arm
from qrobot.model.transform import inverse, so3_log
from qrobot.multi_rccl import (
    EQ,
    TL,
    TRANS,
    Manip,
    RobotManip,
    maintain,
    make_position,
    move,
    rccl_control,
    rccl_open,
    setjvel,
    setvel,
    tracking_mode,
    wait_for,
)
from qrobot.rccl import gentr_rpy, gentr_trsl
from qrobot.rccl.transforms import Transform
from qrobot.servo.memory.telemetry import Rows

ROBOT = load_robot("puma560")
ARM = Arm(ROBOT)
TOOL = gentr_trsl("TOOL", 0, 0, 150)
WORLD: Final = {"left": gentr_trsl("LEFT", 0, 0, 0), "right": gentr_rpy("RIGHT", 1000, 0, 0, 180, 0, 0)}
"""The world in the base of either arm."""
GRIP: Final = {"left": gentr_trsl("GRIP1", 0, 100, 0), "right": gentr_trsl("GRIP2", 0, -100, 0)}
"""Each hand in the object."""
HERE = gentr_rpy("HERE", 500, 0, 0, 0, 170, 0)
THERE = gentr_rpy("THERE", 500, 0, 100, 0, 180, 0)
"""Where the object is, and where it is carried."""


def off(there: Floats, here: Floats) -> tuple[float, float]:
    """Distance, m, and angle, rad, between two poses."""
    between = inverse(there) @ here
    return float(np.linalg.norm(between[:3, 3])), float(np.linalg.norm(so3_log(between[:3, :3])))


def hand(name: str, q: Floats) -> Floats:
    """Its pose in the world with joints `q` (n,). Shape (4, 4)."""
    return np.asarray(inverse(WORLD[name].value) @ ARM.forward(q) @ TOOL.value)


def hand_of(name: str, rows: Rows, t_ns: int, what: str) -> Floats:
    """Its pose in the world at an instant between two cycles: where it was, or should have been. Shape (4, 4)."""
    return hand(name, np.array([np.interp(t_ns, rows["t_ns"], joint) for joint in rows[what].T]))


def reach(grips: Mapping[str, Transform] = GRIP) -> tuple[Manip, list[RobotManip]]:
    """Open the object, which stays HERE, and both arms, whose hands go to it and track it."""
    obj, robots = approach(grips)
    for robot in robots:
        wait_for(robot.completed)
    return obj, robots


def approach(grips: Mapping[str, Transform] = GRIP) -> tuple[Manip, list[RobotManip]]:
    """The same, without waiting until they are there."""
    obj = rccl_open("OBJECT_FRAME")
    rccl_control(obj)
    maintain(obj, make_position(TRANS, EQ, HERE, TL, TRANS))
    robots = [robot for name in WORLD if isinstance(robot := rccl_open(name), RobotManip)]
    for robot in robots:
        rccl_control(robot)
        setjvel(robot, share=0.9)
        tracking_mode(robot)
        move(robot, make_position(TRANS, TOOL, EQ, WORLD[robot.name], obj.trans, grips[robot.name], TL, TOOL))
    return obj, robots


def carry(obj: Manip) -> None:
    """Let the object go THERE, with both hands."""
    setvel(obj, 100, 30)
    move(obj, make_position(TRANS, EQ, THERE, TL, TRANS))
