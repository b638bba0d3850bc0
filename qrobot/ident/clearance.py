"""Whether an arm, led through joint space, stays clear of the floor and of its own column, as far as its file tells.

Only the last frame and the flange are looked at: a robot file knows no surfaces. What stands around the arm is for
whoever starts the plan to keep away.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from qrobot.config import Robot
from qrobot.model.arm import Arm

Floats = NDArray[np.float64]

FLOOR: Final = 0.25  # m that wrist and flange stay above the floor: room for a tool
COLUMN: Final = 0.30  # m from the first axis that they keep below the shoulder
_STEP: Final = 0.1  # rad or m of the joint that moves most, between two looks


class Clearance:
    """Looks at poses and straight ways of one robot."""

    def __init__(self, robot: Robot) -> None:
        self._arm, self._geometry = Arm(robot), robot.geometry

    def of_pose(self, q: Floats) -> bool:
        """Wrist and flange are clear at `q` (n,)."""
        T = self._arm.forward(np.ascontiguousarray(q))
        wrist = T[:3, 3]
        return all(map(self._of_point, (wrist, wrist + self._geometry.flange_m * T[:3, 2])))

    def of_way(self, begin: Floats, end: Floats) -> bool:
        """They are so all along a straight way between two joint positions (n,)."""
        looks = 1 + int(np.ceil(np.abs(end - begin).max() / _STEP))
        return all(self.of_pose(begin + share * (end - begin)) for share in np.linspace(0.0, 1.0, looks + 1))

    def _of_point(self, at: Floats) -> bool:
        above_floor = at[2] + self._geometry.base_height_m >= FLOOR
        return bool(above_floor and (at[2] >= 0.0 or np.hypot(at[0], at[1]) >= COLUMN))
