"""The owner of an arm, which cedes control of it to one program at a time, on request, and takes it back.

As ARTS of the paper (section 3.2), "a simple monitor that has control of the manipulator, which it temporarily cedes to
application programs upon request". It is emulated: the owners of a process's arms live as long as the process, so the
next program finds an arm where the one before has left it.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import LinkBusy, LinkLost
from qrobot.motion import MotionLimits, motion_limits

STRIDE: Final = 1.1  # [A] of the way at full speed: the longest that a joint may be sent within a sample


class ArmOwner:
    """Owns one arm, and holds it as long as it is not ceded.

    Args:
        robot: the arm.
        q: where it stands, joint positions of the robot file. Shape (n,).

    Attributes:
        q, v: where it stands, and how fast it is. Shapes (n,).
        holder: the program to which it is ceded; empty for none.
        reason: why it was taken back from its last holder; empty when that let go itself.
    """

    def __init__(self, robot: Robot, q: Floats) -> None:
        self.robot = robot
        self.q, self.v = q.copy(), np.zeros(robot.n)
        self.holder = self.reason = ""
        self._limits: MotionLimits = motion_limits(robot)

    def cede(self, program: str) -> None:
        """Cede control to a program. Raises LinkBusy: another one has it."""
        if self.holder:
            raise LinkBusy(f"{self.robot.name} is ceded to {self.holder}; ask again when that has let go of it")
        self.holder, self.reason = program or "a program without a name", ""

    def obey(self, q: Floats, seconds: float) -> None:
        """Go to `q` within a sample of the holder's.

        Raises:
            LinkLost: control was taken back, or is now, for no joint goes so far within a sample.
        """
        if not self.holder:
            raise LinkLost(f"{self.robot.name} was taken back: {self.reason}")
        if (far := ~(np.abs(q - self.q) <= STRIDE * seconds * self._limits.v_max)).any():
            joint = int(far.argmax())
            self.take_back(f"joint {joint + 1} ({self.robot.joint_names[joint]}) was sent too far within one sample")
            raise LinkLost(f"{self.robot.name} was taken back: {self.reason}")
        self.v, self.q = (q - self.q) / seconds, q.copy()

    def take_back(self, reason: str) -> None:
        """End control by the holder, at once: the joints are braked as fast as they may be, and held."""
        self.q = self.q + self.v * np.abs(self.v) / (2.0 * self._limits.a_stop)
        self.v = np.zeros_like(self.v)
        self.holder, self.reason = "", reason

    def release(self) -> None:
        """The holder lets go; does nothing when it has no control any more."""
        if self.holder:
            self.take_back("")


_owners: dict[str, ArmOwner] = {}


def owner_of(robot: Robot, q: Floats) -> ArmOwner:
    """The owner of the arm of that name; one that has none yet stands at `q`."""
    return _owners.setdefault(robot.name, ArmOwner(robot, q))


def dismiss_owners() -> None:
    """Forget all arms and where they stand."""
    _owners.clear()
