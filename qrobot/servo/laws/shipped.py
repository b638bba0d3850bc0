"""The control laws there are: shipped ones by name, users' own as `path/to/file.py:name`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from qrobot.config import Robot
from qrobot.servo.laws.adaptive import adaptive
from qrobot.servo.laws.computed_torque import computed_torque
from qrobot.servo.laws.feedback import pd, qrobot, qrobot_acceleration
from qrobot.servo.laws.file import load_law
from qrobot.servo.laws.force import force
from qrobot.servo.laws.impedance import cartesian_impedance, joint_impedance
from qrobot.servo.laws.law import Law
from qrobot.servo.laws.names import check_law_name, is_file_law
from qrobot.servo.laws.unimation import unimation

LAWS: Final[dict[str, Callable[[Robot], Law]]] = {
    "pd": lambda _robot: pd,
    "qrobot": lambda _robot: qrobot,
    "qrobot+a": lambda _robot: qrobot_acceleration,
    "computed-torque": computed_torque.for_robot,
    "adaptive": adaptive.for_robot,
    "force": force.for_robot,
    "joint_impedance": joint_impedance,
    "cartesian_impedance": cartesian_impedance,
    "unimation": lambda _robot: unimation,
}
"""The shipped laws, each made for a robot: some carry its model. The names are those of `servo.laws.names`."""


def find_law(name: str, robot: Robot, settings: Mapping[str, float] | None = None) -> Law:
    """A law for a robot, with its settings.

    Raises:
        ConfigError: there is no such law; or its file, its code or one of `settings` is wrong.
    """
    check_law_name(name)
    found = load_law(name, robot) if is_file_law(name) else LAWS[name](robot)
    return found.with_settings(settings) if settings else found
