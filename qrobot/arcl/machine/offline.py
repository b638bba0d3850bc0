"""The off-line machine: there is no arm. Setpoints and requests go into a stream, and time passes while somebody waits.

Its arm follows every setpoint exactly and at once.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arcl.machine.emulated import EmulatedMachine, start_of
from qrobot.arcl.machine.interface import MachineSettings, PathKeeper
from qrobot.arrays import Floats
from qrobot.motion import MotionLimits

OFFLINE_PERIOD_MS: Final = 56.0  # dT in Figure 5 of the paper


class OfflineMachine(EmulatedMachine):
    """See `RobotMachine`.

    Args:
        settings: what it is made with.

    Raises:
        MotionError: no such sample period. ConfigError: the stream cannot be written.
    """

    def __init__(self, settings: MachineSettings) -> None:
        super().__init__("offl", settings, OFFLINE_PERIOD_MS, lambda period_s: IdealArm(start_of(settings), period_s))

    def keep_path(self, keeper: PathKeeper) -> None:
        """See `RobotMachine.keep_path`: this arm is never stopped."""


class IdealArm:
    """See `EmulatedArm`: it is where it was told to be.

    Args:
        q: where it stands. Shape (n,).
        period_s: sample period.
    """

    measures = False

    def __init__(self, q: Floats, period_s: float) -> None:
        self._q, self._v, self._period_s = q, np.zeros_like(q), period_s

    def take(self) -> Floats:
        """See `EmulatedArm.take`."""
        return self._q.copy()

    def follow(self, q: Floats) -> None:
        """See `EmulatedArm.follow`."""
        self._q, self._v = q, (q - self._q) / self._period_s

    def read(self) -> tuple[Floats, Floats]:
        """See `EmulatedArm.read`."""
        return self._q, self._v

    def narrow(self, limits: MotionLimits) -> MotionLimits:
        """See `EmulatedArm.narrow`."""
        return limits

    def leave(self) -> None:
        """See `EmulatedArm.leave`."""
