"""Emulated axes: an amplifier that holds a velocity, a motor and an encoder for each joint.

What they take is a word of twelve bits, what they give is a counter. They keep no position: an amplifier's offset, a
load or a rounded word makes an axis drift as long as nobody closes a loop about it.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arrays import Bools, Floats, Ints
from qrobot.config import Robot
from qrobot.model.transmission import transmission_params

FULL_WORD: Final = 2047  # twelve bits with a sign
HEADROOM: Final = 1.25  # [A] full word over the speed that the joints' fastest motions need
LAG_S: Final = 0.005  # [A] of the amplifier's own velocity loop
OFFSET: Final = 1e-3  # [A] of full speed, which an amplifier turns at with the word 0


class VelocityAxes:
    """The axes of one arm, between words and counters.

    Args:
        robot: whose gears, encoders and speeds they have.
        q: joint positions of the robot file where they stand. Shape (n,).

    Attributes:
        full_speed: counts/s at the full word. Shape (n,).
        blocked: axes that something holds. Shape (n,).
    """

    def __init__(self, robot: Robot, q: Floats) -> None:
        self._params = transmission_params(robot)
        self.full_speed: Floats = HEADROOM * robot.transmission.count_rates(robot.limits.v_max)
        self.blocked: Bools = np.zeros(robot.n, dtype=bool)
        self._place = self.counts_at(q)
        self._speed = np.zeros(robot.n)

    def counts_at(self, q: Floats) -> Floats:
        """Counters at joint positions, not rounded. Shape (n,)."""
        counts: Floats = self._params.count_per_joint @ (q - self._params.q_offset)
        return counts

    def joints_at(self, counts: Floats | Ints) -> Floats:
        """Joint positions at counters. Shape (n,)."""
        q: Floats = self._params.q_offset + self._params.joint_per_count @ counts
        return q

    def joint_errors(self, counts: Floats) -> Floats:
        """Joint units that so many counts of each motor alone are. Shape (n,)."""
        errors: Floats = np.abs(self._params.rad_per_count * counts)
        return errors

    @property
    def counters(self) -> Ints:
        """The encoders. Shape (n,)."""
        return np.floor(self._place).astype(np.int64)

    def run(self, words: Ints, seconds: float) -> None:
        """Let time pass with these words, which an amplifier limits to its own. Shape (n,)."""
        asked = (np.clip(words, -FULL_WORD, FULL_WORD) / FULL_WORD + OFFSET) * self.full_speed
        self._speed += (asked - self._speed) * (1.0 - np.exp(-seconds / LAG_S))
        self._speed[self.blocked] = 0.0
        self._place += self._speed * seconds
