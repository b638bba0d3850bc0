"""All the arithmetic of an identification, from the rows of a log to what they tell."""

from __future__ import annotations

from qrobot.config import Robot
from qrobot.ident.base import base_of_robot
from qrobot.ident.consistent import nearest_links
from qrobot.ident.model import Identified, identify
from qrobot.ident.observe import Observer
from qrobot.ident.regressor import gravity_regressor
from qrobot.servo.telemetry import Rows


def identify_log(robot: Robot, rows: Rows, period_s: float) -> Identified:
    """Gravity and friction from rows of shape (r,), one every `period_s`; rows of several logs may follow each other.

    Twice: the inertial torque is taken off first with the links of the robot file, then with those found.

    Raises:
        IdentificationError: the rows do not tell them, or no bodies have that gravity.
    """
    regressor = gravity_regressor(robot)
    base = base_of_robot(robot, regressor)
    first = identify(robot, base, regressor, Observer(robot, regressor, base).observe(rows, period_s))
    mass, com = nearest_links(robot, base, first.beta)
    links = robot.links.model_copy(update={"mass": mass, "com": com})
    better = robot.model_copy(update={"links": links})
    return identify(robot, base, regressor, Observer(robot, regressor, base, better).observe(rows, period_s))
