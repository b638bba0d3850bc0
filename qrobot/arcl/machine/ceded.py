"""The machine of an arm that somebody else owns, and cedes on request (`arm_owner`)."""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arcl.machine.arm_owner import owner_of
from qrobot.arcl.machine.emulated import SAMPLE_MS, EmulatedMachine, start_of
from qrobot.arcl.machine.interface import MachineSettings
from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.motion import MotionLimits

_THERE: Final = 1e-6  # rad or m


class CededMachine(EmulatedMachine):
    """See `RobotMachine`; the arm is emulated.

    Args:
        settings: what it is made with; `start` counts for an arm that was not ceded before.

    Raises:
        MotionError: no such sample period, or the arm stands elsewhere than at `start`.
        ConfigError: the stream cannot be written.
    """

    def __init__(self, settings: MachineSettings) -> None:
        super().__init__("ceded", settings, SAMPLE_MS, lambda period_s: CededArm(settings, period_s))


class CededArm:
    """See `EmulatedArm`.

    Args:
        settings: of its machine.
        period_s: sample period.

    Attributes:
        owner: of the arm.
    """

    measures = True

    def __init__(self, settings: MachineSettings, period_s: float) -> None:
        self._period_s, self._zero, self._program = period_s, settings.zero, settings.program
        self.owner = owner_of(settings.robot, start_of(settings) + settings.zero)
        self._asked = settings.start
        self._mine = False

    def take(self) -> Floats:
        """See `EmulatedArm.take`. Raises LinkBusy: another program has it. MotionError: it stands elsewhere."""
        self.owner.cede(self._program)
        self._mine = True
        here = self.read()[0]
        if self._asked is not None and not np.allclose(here, self._asked, rtol=0.0, atol=_THERE):
            self.leave()
            raise MotionError("ARCL_START: the arm stands where the program before has left it; leave ARCL_START out")
        return here

    def follow(self, q: Floats) -> None:
        """See `EmulatedArm.follow`. Raises LinkLost: the owner takes, or has taken, the arm back."""
        self.owner.obey(q + self._zero, self._period_s)

    def read(self) -> tuple[Floats, Floats]:
        """See `EmulatedArm.read`."""
        return self.owner.q - self._zero, self.owner.v

    def narrow(self, limits: MotionLimits) -> MotionLimits:
        """See `EmulatedArm.narrow`."""
        return limits

    def leave(self) -> None:
        """See `EmulatedArm.leave`."""
        if self._mine:
            self._mine = False
            self.owner.release()
