"""The place that an arm begins at which is not there: `--start` of the commands that run programs."""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config.deployment import DeployedArm
from qrobot.config.robot import Robot, load_robot
from qrobot.errors import ConfigError
from qrobot.units import M_PER_MM

BESIDE_RANGE: Final = 2e-3  # [A] rad or m: an arm that rests at the end of a range is measured a little beyond it


def start_place(text: str | None, arm: DeployedArm) -> Floats:
    """Joint positions that `text` says, the name of a pose or all joints by commas, in degrees and mm.

    Without it those of the deployment file's `start_pose`. Shape (n,), rad or m.

    Raises:
        ConfigError: there is no such pose, or no such place within the joints' ranges.
    """
    robot = load_robot(arm.robot)
    name = arm.board.start_pose if text is None else text
    if name in robot.poses:
        return robot.poses[name].copy()
    return _within_ranges(name, _numbers(name, robot), robot)


def _numbers(text: str, robot: Robot) -> Floats:
    try:
        values = np.array([float(each) for each in text.split(",")])
    except ValueError:
        poses = ", ".join(robot.poses)
        raise ConfigError(
            f"no place {text!r} to start at: name a pose of {robot.name} ({poses}), or all joints as in 0,-90,90,0,0,0"
        ) from None
    if values.size != robot.n:
        raise ConfigError(f"a place to start at has a number for each of {robot.n} joints, not {values.size}")
    return np.where(robot.prismatic, values * M_PER_MM, np.radians(values))


def _within_ranges(text: str, q: Floats, robot: Robot) -> Floats:
    low, high = robot.limits.q_min, robot.limits.q_max
    outside = np.flatnonzero(~((q >= low - BESIDE_RANGE) & (q <= high + BESIDE_RANGE)))
    if outside.size:
        joint = int(outside[0])
        raise ConfigError(f"start at {text}: joint {joint + 1} ({robot.joint_names[joint]}) is out of its range")
    return q


def start_text(q: Floats, robot: Robot) -> str:
    """The same place as text. `q`: shape (n,), rad or m."""
    values = np.where(robot.prismatic, q / M_PER_MM, np.degrees(q))
    return ",".join(f"{value:.4f}" for value in values)
