"""The duties of a kinematics layer. It works with joint angles in the real world, never with motors or encoders."""

from __future__ import annotations

from typing import Protocol

from qrobot.arrays import Floats
from qrobot.motion import ArmKinematics, MotionLimits


class ManipulatorKinematics(ArmKinematics, Protocol):
    """The engine's kinematics (`forward`, `branch`, `inverse`, `near_singular`), and what ARCL asks for besides.

    Joint positions in rad (m on a sliding joint), shape (n,); poses of T6 in m, shape (4, 4).

    Attributes:
        name: of the arm.
        structure: kinds of the joints, base to flange: R turns, P slides.
        limits: of the joints.
        zero: joint positions of the robot file at this layer's zero. Shape (n,).
    """

    name: str
    structure: str
    limits: MotionLimits
    zero: Floats

    def jacobian(self, q: Floats) -> Floats:
        """`[v; w] = J qd`: velocity and angular velocity of T6 in the base. Shape (6, n)."""

    def jacobian_inverse(self, q: Floats) -> Floats:
        """Its inverse. Shape (n, 6). Raises Singular; MotionError for an arm without six joints."""
