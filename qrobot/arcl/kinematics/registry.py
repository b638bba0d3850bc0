"""Kinematics layers by name: those of the packaged robots, of a user's robot file, and what a program brings itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeAlias

from qrobot.arcl.kinematics.interface import ManipulatorKinematics
from qrobot.arcl.kinematics.robot_file import file_kinematics, puma_kinematics, without_ranges
from qrobot.config import Robot, load_robot
from qrobot.errors import ConfigError

KinematicsMaker: TypeAlias = Callable[[Robot], ManipulatorKinematics]

_MAKERS: Final[dict[str, KinematicsMaker]] = {
    "puma": puma_kinematics,
    "stanford": file_kinematics,
    "generic": file_kinematics,
}


def register_kinematics(name: str, maker: KinematicsMaker) -> None:
    """Make a kinematics layer known under a name; `maker` is called with the robot."""
    _MAKERS[name] = maker


def kinematics_names() -> list[str]:
    """Names that `kinematics` takes as its second argument."""
    return sorted(_MAKERS)


def kinematics(robot: Robot | str, name: str = "", unlimited: bool = False) -> ManipulatorKinematics:
    """The kinematics layer of a robot.

    Args:
        robot: a robot, the name of a packaged one, or the path of a robot file.
        name: of the layer; default the family of the robot file.
        unlimited: joints have no ranges.

    Raises:
        ConfigError: no such robot, no such layer, or the layer is not for this arm.
    """
    arm = load_robot(robot) if isinstance(robot, str) else robot
    chosen = name or arm.geometry.family
    if chosen not in _MAKERS:
        raise ConfigError(f"{arm.name}: no kinematics layer {chosen!r}; there are {', '.join(kinematics_names())}")
    return _MAKERS[chosen](without_ranges(arm) if unlimited else arm)
