"""Places along the straight way of something that is held, one piece after the other, each so short that joints follow.

Near a singular pose joints have far to turn while the tool hardly moves. There the pieces become shorter, and with them
slower, for each takes the same time; behind it they grow again. The tool stays on its straight way all the while.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import MotionError
from qrobot.model.arm import Arm
from qrobot.motion.world.kinematics import ArmKinematics, kinematics_of
from qrobot.rccl.arguments import small_move
from qrobot.rccl.jog import along_axes, moved_by

PIECE_S: Final = 0.4  # [A] of a straight path: so far ahead it is planned
LEAST: Final = 0.005  # [A] share of the speed asked for, below which the tool is led no nearer to a singular pose
GROWS: Final = 1.5  # [A] most that a piece is longer than the one before
SHRINKS: Final = 0.7  # [A] at least, when a piece asks for too much
ROOM: Final = 0.95  # [A] of the greatest joint speed, for a piece that was made shorter
TOO_NEAR: Final = "would turn far for a short way, so near a singular pose; turn a joint to get away from it"
DONE: Final = 1e-6  # of a piece


class StraightWay:
    """Belongs to one press.

    Args:
        robot: the arm.
        start: T6 where it begins. Shape (4, 4).
        q: joints there, rad or m. Shape (n,).
        most: greatest joint speeds, rad/s or m/s. Shape (n,).

    Attributes:
        share: of the speed asked for at which the newest piece is gone along.
    """

    def __init__(self, robot: Robot, start: Floats, q: Floats, most: Floats) -> None:
        self.share = 1.0
        self._robot, self._value, self._q = robot, start, np.array(q)
        self._most = most
        self._kinematics = kinematics_of(Arm(robot))
        self._axis, self._speed, self._length, self._in_base = "dx", 0.0, 0.0, True
        self._axes: Floats | None = None
        self._left = np.inf
        self._next = self._value, self._q

    def choose(
        self, axis: str, speed: float, in_base: bool, step: float = 0.0, axes: Floats | None = None
    ) -> StraightWay:
        """Go along or about an axis, at `speed` mm/s or degrees/s with its sign, by `step` (0 for on and on).

        Axes as in `HeldMotion.go_along`.
        """
        self._axis, self._speed, self._in_base, self._axes = axis, speed, in_base or axes is not None, axes
        piece = abs(speed) * PIECE_S
        self._length = step / np.ceil(step / piece - DONE) if step else piece
        self._left = step / self._length if step else np.inf
        return self

    @property
    def piece(self) -> float:
        """Length of the piece that was proposed, mm or degrees."""
        return self._length * min(self.share, self._left)

    @property
    def done(self) -> bool:
        """The step has been gone."""
        return self._left < DONE

    def propose(self) -> Floats:
        """Next place (4, 4), as far as the joints allow. Raises MotionError: a singular pose is too near, or an end."""
        kinematics = self._known_kinematics()
        while True:
            T = self._ahead()
            try:
                q = kinematics.inverse(T, kinematics.branch(self._q), self._q, singular=True)
            except MotionError as error:  # beyond its reach, or in a singular pose
                self.shorten(error)
                continue
            busiest, needed = self._busiest(q)
            if needed <= 1.0:
                self._next = T, q
                return T
            self.shorten(MotionError(f"{self._named(busiest)} {TOO_NEAR}"), ROOM / needed)

    def shorten(self, why: MotionError, by: float = SHRINKS) -> None:
        """Make the piece that was proposed shorter. Raises `why` when it is too short then, as `propose` does."""
        self.share *= min(by, SHRINKS)
        if self.share < LEAST:
            raise MotionError(f"the arm can go no further this way: {why}")

    def accept(self) -> None:
        """The piece that was proposed is gone along."""
        (self._value, self._q), self._left = self._next, self._left - min(self.share, self._left)
        self.share = min(1.0, GROWS * self.share)

    def _ahead(self) -> Floats:
        piece = small_move(self._axis, (np.sign(self._speed) * self.piece,))
        if self._axes is not None:
            piece = along_axes(piece, self._axes)
        return moved_by(self._value, piece, self._in_base)

    def _busiest(self, q: Floats) -> tuple[int, float]:
        """Joint with most to do on the way to `q` (n,), and share of its greatest speed that it needs."""
        shares = np.abs(q - self._q) / (self._most * PIECE_S)
        return int(shares.argmax()), float(shares.max())

    def _named(self, joint: int) -> str:
        return f"joint {joint + 1} ({self._robot.joint_names[joint]})"

    def _known_kinematics(self) -> ArmKinematics:
        if self._kinematics is None:
            raise MotionError(f"{self._robot.name} goes along no axis: it has too few joints for any pose")
        return self._kinematics
