"""Length of the way back to a path that was left, and how long it may be without anybody saying more."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import MotionError
from qrobot.units import DEG_PER_RAD, MM_PER_M, RAD_PER_DEG

ToolPose: TypeAlias = Callable[[Floats], Floats]  # of joints (n,): T6 (4, 4)

PIECES: Final = 16  # of the way, straight for the joints, along which the flange is followed


@dataclass(frozen=True)
class WayBackLimit:
    """Greatest way back.

    Attributes:
        way_m: of the flange, and of a joint that slides, m.
        turn: of a joint that turns, rad.
    """

    way_m: float = 0.3  # [A] an arm that sags, is pushed away or was thrown back by what it met stays within
    turn: float = 45.0 * RAD_PER_DEG  # [A]

    def objection(self, robot: Robot, forward: ToolPose, q: Floats, goal: Floats) -> MotionError | None:
        """Reason for which an arm at `q` may not go to `goal`, both (n,), in a straight line of its joints."""
        flange = [forward(q + share * (goal - q))[:3, 3] for share in np.linspace(0.0, 1.0, PIECES + 1)]
        way = float(np.linalg.norm(np.diff(flange, axis=0), axis=1).sum())
        moves = np.abs(goal - q) / np.where(robot.prismatic, self.way_m, self.turn)
        j = int(moves.argmax())
        if way <= self.way_m and moves[j] <= 1.0:
            return None
        move = abs(float(goal[j] - q[j]))
        joint = f"{move * MM_PER_M:.0f} mm" if robot.prismatic[j] else f"{move * DEG_PER_RAD:.0f} deg"
        found = f"{way * MM_PER_M:.0f} mm at the flange and {joint} of {robot.joint_names[j]}"
        allowed = f"{self.way_m * MM_PER_M:.0f} mm and {self.turn * DEG_PER_RAD:.0f} deg are allowed"
        further = "allow more by keep_path and confirm again, or give the path up by stop"
        return MotionError(f"the way back to the path is too long: {found}, {allowed}; {further}")
