"""Factors from a program's joint positions to those of the layers below."""

from __future__ import annotations

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.units import M_PER_MM, RAD_PER_DEG


def units_of(robot: Robot) -> Floats:
    """rad per degree; m per mm on a sliding joint. Shape (n,)."""
    return np.where(robot.prismatic, M_PER_MM, RAD_PER_DEG)
