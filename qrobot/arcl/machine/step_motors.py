"""Emulated stepping motors: each turns by a step when a pulse comes, and loses those that come too fast for it."""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arrays import Floats, Ints

SHORTEST_S: Final = 200e-6  # [A] between two steps the same way: a faster motor falls out of step
SETTLING_S: Final = 20e-6  # [A] between a step and one the other way: the direction has to be there before the pulse


class StepMotors:
    """Motors of an arm.

    Args:
        steps: where they stand. Shape (n,).

    Attributes:
        steps: where they stand now. Shape (n,).
        lost: pulses that turned no motor. Shape (n,).
    """

    def __init__(self, steps: Ints) -> None:
        self.steps = steps.copy()
        self.lost = np.zeros_like(steps)
        self._way = np.zeros_like(steps)
        self._last_s = np.full(steps.shape, -np.inf)

    def pulse(self, motor: int, way: int, times_s: Floats) -> None:
        """Take pulses with one direction, +1 or -1, at these times, oldest first."""
        for time_s in times_s.tolist():
            needed = SHORTEST_S if way == self._way[motor] else SETTLING_S
            if time_s - self._last_s[motor] >= needed:
                self.steps[motor] += way
            else:
                self.lost[motor] += 1
            self._last_s[motor], self._way[motor] = time_s, way
