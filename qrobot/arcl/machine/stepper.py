"""The machine of an arm with stepping motors: it makes their pulses, step and direction, in software.

As the one of the MIM-5 educational robot of the paper (section 3.2), which "generates stepper motor motion pulses in
software". The setpoint of a sample is approached on a straight line, and a pulse is due where it passes from one step
to the next, at a tick of the timer. The arm has no encoders: it is where its pulses have sent it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from qrobot.arcl.machine.emulated import SAMPLE_MS, EmulatedMachine, start_of
from qrobot.arcl.machine.interface import MachineSettings
from qrobot.arcl.machine.step_motors import StepMotors
from qrobot.arrays import Floats
from qrobot.errors import ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.motion import MotionLimits

STEPS_PER_TURN: Final = 200  # of the usual motor of 1.8 degrees a step
TICK_S: Final = 25e-6  # [A] of the timer that makes the pulses
MOST_PER_S: Final = 4000.0  # [A] steps a second: a pulse has room for a tick more or less (see `SHORTEST_S`)
MOST_PER_S2: Final = 40_000.0  # [A] steps/s2: this many more a second the motors can turn
PLANNED: Final = 0.98  # [A] of the speed, for the rounding of a plan to samples
PLAY: Final = 0.25  # of a step beyond the middle between two, so that a setpoint at rest there sends no pulses


class StepperMachine(EmulatedMachine):
    """See `RobotMachine`; its arm is emulated, with the gears of the robot file and without coupling of the wrist.

    Args:
        settings: what it is made with.

    Raises:
        MotionError: no such sample period. ConfigError: the stream cannot be written.
    """

    def __init__(self, settings: MachineSettings) -> None:
        super().__init__("stepper", settings, SAMPLE_MS, lambda period_s: StepperArm(settings, period_s))


class StepperArm:
    """See `EmulatedArm`.

    Args:
        settings: of its machine.
        period_s: sample period.

    Attributes:
        motors: that take the pulses.
        steps_per_unit: steps per rad (m) of each joint. Shape (n,).
    """

    measures = False

    def __init__(self, settings: MachineSettings, period_s: float) -> None:
        self._names, self._period_s = settings.robot.joint_names, period_s
        self.steps_per_unit: Floats = settings.robot.transmission.gear * (STEPS_PER_TURN / (2.0 * np.pi))
        self._place = start_of(settings) * self.steps_per_unit
        self._sent = np.round(self._place).astype(np.int64)
        self.motors = StepMotors(self._sent)
        self._begun_s, self._v = 0.0, np.zeros(settings.robot.n)

    def take(self) -> Floats:
        """See `EmulatedArm.take`."""
        return self.read()[0]

    def follow(self, q: Floats) -> None:
        """See `EmulatedArm.follow`. Raises ServoFault: a motor would have to turn faster than it can."""
        goal = q * self.steps_per_unit
        self._check(np.abs(goal - self._place) / self._period_s)
        was = self._sent.copy()
        for joint in range(goal.size):
            self._send(joint, self._place[joint], goal[joint])
        self._place, self._begun_s = goal, self._begun_s + self._period_s
        self._v = (self._sent - was) / (self.steps_per_unit * self._period_s)

    def read(self) -> tuple[Floats, Floats]:
        """See `EmulatedArm.read`: by the pulses that were sent."""
        return self._sent / self.steps_per_unit, self._v

    def narrow(self, limits: MotionLimits) -> MotionLimits:
        """See `EmulatedArm.narrow`: those of the motors beside those of the joints."""
        speed, change = PLANNED * MOST_PER_S / self.steps_per_unit, MOST_PER_S2 / self.steps_per_unit
        return replace(
            limits,
            v_max=np.minimum(limits.v_max, speed),
            a_max=np.minimum(limits.a_max, change),
            a_stop=np.minimum(limits.a_stop, change),
        )

    def leave(self) -> None:
        """See `EmulatedArm.leave`: motors without pulses hold."""

    def _check(self, rates: Floats) -> None:
        """Raise ServoFault for steps per second that a motor cannot do."""
        if (fast := ~(rates <= MOST_PER_S)).any():
            joint = int(fast.argmax())
            raise ServoFault(
                FaultCode.SP_STEP,
                f"SP_STEP: joint {joint + 1} ({self._names[joint]}) would need {rates[joint]:.0f} steps/s, its motor "
                f"takes {MOST_PER_S:.0f}: send it there more slowly",
            )

    def _send(self, joint: int, begin: float, end: float) -> None:
        """The pulses of one motor for the way from `begin` to `end` (steps) within one sample."""
        way = 1 if end > begin else -1
        first, due = int(self._sent[joint]), way * (end - self._sent[joint]) - PLAY - 0.5
        count = int(np.floor(due)) + 1 if due >= 0.0 else 0
        if not count:
            return
        passed = first + way * (np.arange(count) + 0.5 + PLAY)  # where each pulse is due
        times_s = np.clip((passed - begin) / (end - begin), 0.0, 1.0) * self._period_s
        self.motors.pulse(joint, way, self._begun_s + np.ceil(times_s / TICK_S) * TICK_S)
        self._sent[joint] += way * count
