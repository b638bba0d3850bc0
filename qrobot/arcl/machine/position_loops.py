"""The machine of an arm whose axes keep no position: the loops about them are closed here, in software.

As on the Journeyman robot of the paper (section 3.2), whose machine layer "uses software position control loops": once
a millisecond the counters are read, and each axis gets the velocity of its setpoint, and as much more as its error asks
for. The setpoint of a sample is approached on a straight line, a sample late.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arcl.machine.emulated import SAMPLE_MS, EmulatedMachine, start_of
from qrobot.arcl.machine.interface import MachineSettings
from qrobot.arcl.machine.velocity_axes import FULL_WORD, VelocityAxes
from qrobot.arrays import Floats, Ints
from qrobot.errors import ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.motion import MotionLimits
from qrobot.units import DEG_PER_RAD

LOOP_S: Final = 1e-3  # [A]
KP: Final = 40.0  # [A] 1/s; a fifth of what the amplifier's lag allows
KI: Final = 200.0  # [A] 1/s2; takes the amplifiers' offsets out within half a second
SUM_SHARE: Final = 0.1  # [A] of full speed: the most that summed errors may ask for


class LoopMachine(EmulatedMachine):
    """See `RobotMachine`; its arm is emulated.

    Args:
        settings: what it is made with.

    Raises:
        MotionError: no such sample period. ConfigError: the stream cannot be written.
    """

    def __init__(self, settings: MachineSettings) -> None:
        super().__init__("loops", settings, SAMPLE_MS, lambda period_s: LoopedArm(settings, period_s))


class LoopedArm:
    """See `EmulatedArm`.

    Args:
        settings: of its machine.
        period_s: sample period.

    Attributes:
        axes: what the loops are closed about.
    """

    measures = True

    def __init__(self, settings: MachineSettings, period_s: float) -> None:
        self._robot, self._zero, self._period_s = settings.robot, settings.zero, period_s
        self.axes = VelocityAxes(settings.robot, start_of(settings) + settings.zero)
        self._ticks = max(1, round(period_s / LOOP_S))
        self._setpoint = self._measured
        self._sum = np.zeros(settings.robot.n)
        self._v = np.zeros(settings.robot.n)

    def take(self) -> Floats:
        """See `EmulatedArm.take`."""
        return self.read()[0]

    def follow(self, q: Floats) -> None:
        """See `EmulatedArm.follow`. Raises ServoFault: an axis is too far from its setpoint; all of them are halted."""
        before, goal = self._setpoint, self.axes.counts_at(q + self._zero)
        was, tick_s = self.read()[0], self._period_s / self._ticks
        rate = (goal - before) / self._period_s
        for tick in range(self._ticks):
            self.axes.run(self._words(before + (tick + 1) * tick_s * rate, rate, tick_s), tick_s)
        self._setpoint, self._v = goal, (self.read()[0] - was) / self._period_s

    def read(self) -> tuple[Floats, Floats]:
        """See `EmulatedArm.read`."""
        return self.axes.joints_at(self._measured) - self._zero, self._v

    def narrow(self, limits: MotionLimits) -> MotionLimits:
        """See `EmulatedArm.narrow`: amplifiers and motors are chosen for the arm."""
        return limits

    def leave(self) -> None:
        """See `EmulatedArm.leave`: brakes hold what no loop does any more."""
        self.axes.blocked[:] = True

    @property
    def _measured(self) -> Floats:
        """Counters as places: each stands for the middle of its count. Shape (n,)."""
        return self.axes.counters.astype(np.float64) + 0.5

    def _words(self, reference: Floats, rate: Floats, tick_s: float) -> Ints:
        """The law: what each amplifier is told now."""
        error = reference - self._measured
        self._check(error)
        most = SUM_SHARE * self.axes.full_speed / KI
        self._sum = np.clip(self._sum + error * tick_s, -most, most)
        speed = rate + KP * error + KI * self._sum
        return np.round(FULL_WORD * speed / self.axes.full_speed).astype(np.int64)

    def _check(self, error: Floats) -> None:
        """Raise ServoFault when an axis does not follow."""
        off, allowed = self.axes.joint_errors(error), self._robot.guard.following_error
        if (far := ~(off <= allowed)).any():
            joint = int(far.argmax())
            unit, per = ("mm", 1e3) if self._robot.prismatic[joint] else ("deg", DEG_PER_RAD)
            raise ServoFault(
                FaultCode.FOLLOWING,
                f"FOLLOWING: joint {joint + 1} ({self._robot.joint_names[joint]}) is {off[joint] * per:.1f} {unit} "
                f"from its setpoint, {allowed[joint] * per:.1f} allowed: see what holds it, then open the robot anew",
            )
