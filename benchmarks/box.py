"""The box motion: four corners in joint space, round and round, as the frames a program would send."""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np
from numpy.typing import NDArray

from qrobot.config import Robot
from qrobot.motion import Generator, JointSpeed, MoveRequest, motion_limits

FRAME_NS: Final = 28_000_000
SPEED: Final = 0.6  # rad/s of the fastest joint
REACH: Final = 0.35  # rad from the middle to each corner
CORNERS: Final = ((1, 1), (1, -1), (-1, -1), (-1, 1))  # signs of joints 1 and 3; the others follow a little


def setpoints(robot: Robot, seconds: float) -> NDArray[np.float64]:
    """Positions of every frame from the robot's `ready` pose on, as long as asked. Shape (frames, n), rad or m."""
    middle = robot.poses["ready"]
    generator = Generator(motion_limits(robot), FRAME_NS * 1e-9, middle)
    corners = itertools.cycle(CORNERS)
    frames = [middle]
    for tick in range(1, round(seconds * 1e9 / FRAME_NS)):
        while generator.waiting < 2:
            generator.push(MoveRequest("corner", _corner(middle, *next(corners)), JointSpeed(SPEED)))
        frames.append(generator.update(tick).q)
    return np.array(frames)


def _corner(middle: NDArray[np.float64], first: int, second: int) -> NDArray[np.float64]:
    """A corner: joints take turns in following the two signs."""
    signs = np.resize([first, second], middle.size)
    return middle + REACH * signs / np.arange(1, middle.size + 1)
