"""Kinematics of a frame that no arm carries: a virtual manipulator that takes any pose (Lloyd et al. 1987, section 3).

Its six coordinates are position and rotation vector, so that the trajectory generator moves it as it moves an arm, in
Cartesian mode. They are no joints: joint mode and joint angles mean nothing here.

A rotation vector is followed on from the one before it: a frame may turn on and on about one axis. Near a whole turn
there is no continuous one about another axis, and a motion that passes there ends. From rest turns are counted anew.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.model.branch import Branch
from qrobot.model.transform import so3_exp, so3_log, transform
from qrobot.motion.world.limits import MotionLimits

NAMES: Final = ("x", "y", "z", "turn about x", "turn about y", "turn about z")
LINEAR: Final = (1.0, 5.0)  # speed, m/s, and acceleration, m/s^2, of a frame [A]; its arms have limits of their own
ANGULAR: Final = (5.0, 25.0)  # rad/s, rad/s^2 [A]
_SMALL: Final = 1e-9  # rad: a rotation without an axis


def frame_limits() -> MotionLimits:
    """Limits of a frame's motion: a pace that arms can follow, and no ends."""
    (v, a), (w, b) = LINEAR, ANGULAR
    slides = np.array([True, True, True, False, False, False])
    endless, fast, hard = np.full(6, np.inf), np.where(slides, v, w), np.where(slides, a, b)
    return MotionLimits(-endless, endless, fast, hard, hard, slides, NAMES)


class FrameKinematics:
    """See `ArmKinematics`; coordinates have shape (6,), m and rad."""

    def forward(self, q: Floats) -> Floats:
        """The pose. Shape (4, 4)."""
        return transform(so3_exp(q[3:]), q[:3])

    def branch(self, _q: Floats) -> Branch:
        """The one that stands for all."""
        return Branch.RUN

    def inverse(self, T: Floats, branch: Branch, near: Floats, singular: bool = False) -> Floats:  # noqa: ARG002
        """Coordinates of a pose, the rotation vector by whole turns nearest to that of `near`."""
        return np.concatenate([T[:3, 3], _by_whole_turns(so3_log(T[:3, :3]), near[3:])])

    def near_singular(self, _q: Floats) -> bool:
        """Every motion of the frame is one of its coordinates."""
        return False


def _by_whole_turns(r: Floats, near: Floats) -> Floats:
    """The rotation vector nearest to `near`, among those that mean the same as `r` (3,)."""
    angle = float(np.linalg.norm(r))
    if angle > _SMALL:
        axis = r / angle
    elif (length := float(np.linalg.norm(near))) > _SMALL:
        axis = near / length
    else:
        return r
    turns = np.round((float(axis @ near) - angle) / (2.0 * np.pi))
    return np.asarray((angle + 2.0 * np.pi * turns) * axis)
