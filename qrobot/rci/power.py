"""Power-up of an arm in any state until it holds its position, and power-down; one step per sample."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from qrobot.errors import MotionError, ServoFault
from qrobot.faultcodes import NO_JOINT, FaultCode, explain
from qrobot.modecodes import mode_name
from qrobot.rci.blackboard import Chg
from qrobot.wire import Mode, RobotState

PATIENCE_S: Final = 6.0  # twice what the servo itself waits for power
REACTION_S: Final = 0.15  # for the servo to answer a request
CARRIED: Final = frozenset({Mode.HOLDING, Mode.TRACKING, Mode.STOPPING})
"""Modes in which the servo carries the arm, or brings it to rest."""
SAME_AGAIN_S: Final = 1.0  # [A] with the event that stood there before: until then it may not have heard the request
ARRIVED: Final = 1e-6  # rad or m
LET_GO: Final = "no fault; somebody took its power away"


def servo_fault(robot: RobotState, what: str, trace: Sequence[RobotState] = (), without_fault: str = "") -> ServoFault:
    """The error for a servo that gave up: its latched fault, or else what it reported last; `trace` ends with it.

    `without_fault` is the reason when it reported nothing, by default its mode.
    """
    code = robot.fault or robot.event
    joint = robot.event_joint if code == robot.event else NO_JOINT
    reason = explain(code, joint) if code else without_fault or f"the servo is in mode {mode_name(robot.mode)}"
    return ServoFault(code, f"{what}: {reason}", tuple(trace))


class PowerUp:
    """Asks for power until the arm holds its position.

    Power comes only on a request that is raised while the servo is off, so the request is lowered for one sample first.

    Args:
        period_s: sample period.
        clear_fault: clear a latched fault first instead of raising it.
        carried: the servo carries the arm. A fault, or an end of its power, is news then that nobody has answered: it
            is told. So it is once the arm has held.
    """

    def __init__(self, period_s: float, clear_fault: bool, carried: bool = False) -> None:
        self._period_s = period_s
        self._may_clear, self._carried = clear_fault, carried
        self._elapsed_s = 0.0
        self._asked_s: float | None = None  # when power, or a clear, was asked for
        self._event_before = 0  # told before power was
        self._powering = False  # it was seen to come on, whoever had asked for it

    def step(self, robot: RobotState, chg: Chg) -> bool:
        """Say the next request in `chg`; True once the arm holds.

        Raises:
            ServoFault: a fault is latched, power is refused, or gone from an arm that was carried; or nothing happens
                in time.
            MotionError: the arm is not calibrated.
        """
        self._elapsed_s += self._period_s
        if self._elapsed_s > PATIENCE_S:
            raise servo_fault(robot, f"the arm did not come to hold within {PATIENCE_S:g} s")
        if self._carried and robot.mode not in CARRIED:
            raise servo_fault(robot, "the servo has let go of the arm before it followed", (), LET_GO)
        match robot.mode:
            case Mode.FAULT:
                self._leave_fault(robot, chg)
            case Mode.OFF if self._powering and robot.event == FaultCode.POWER_STOPPED:
                raise servo_fault(robot, "no arm power")  # not asked for anew against somebody's stop
            case Mode.OFF:
                self._ask(robot, chg)
            case Mode.UNCALIBRATED:
                raise MotionError(
                    "the arm has power but is not calibrated: its joint angles are unknown until `qrobot calibrate`"
                )
            case _:  # powering, or coming to rest after somebody else's program
                chg.power = True
                self._powering = self._powering or robot.mode == Mode.POWERING
        self._carried = self._carried or robot.mode == Mode.HOLDING
        return robot.mode == Mode.HOLDING

    def _ask(self, robot: RobotState, chg: Chg) -> None:
        if self._asked_s is None or not chg.power:  # not a request that was raised before it came to be off
            chg.power = self._asked_s is not None  # low at first
            self._asked_s, self._event_before = self._elapsed_s, robot.event
        elif robot.event and self._waited(SAME_AGAIN_S if robot.event == self._event_before else REACTION_S):
            raise servo_fault(robot, "no arm power")

    def _leave_fault(self, robot: RobotState, chg: Chg) -> None:
        if not self._may_clear or (self._asked_s is not None and self._waited(2 * REACTION_S)):
            raise servo_fault(robot, "the servo is in a fault")
        chg.power = False
        chg.clear_fault = self._asked_s is None
        self._asked_s = self._elapsed_s if self._asked_s is None else self._asked_s

    def _waited(self, seconds: float) -> bool:
        return self._asked_s is not None and self._elapsed_s - self._asked_s > seconds


class PowerDown:
    """Lets the servo finish the last setpoints, ends the stream, and switches power off if asked.

    Args:
        period_s: sample period.
        power_off: leave the arm without power, its brakes closed; otherwise it keeps holding its position.
    """

    def __init__(self, period_s: float, power_off: bool) -> None:
        self._period_s = period_s
        self._power_off = power_off
        self._elapsed_s = 0.0
        self._stopped = False

    def ask_off(self) -> None:
        """Leave the arm without power after all, with all the time there is for it."""
        self._power_off, self._elapsed_s = True, 0.0

    def step(self, robot: RobotState, chg: Chg) -> bool:
        """Say the next request in `chg`; True when there is nothing left to wait for."""
        self._elapsed_s += self._period_s
        arrived = not any(chg.modes) or np.allclose(robot.q_setpoint, chg.setpoints, rtol=0.0, atol=ARRIVED)
        if not self._stopped and (arrived or robot.mode != Mode.TRACKING):
            chg.hold()
            chg.stop = self._stopped = True
        chg.power = chg.power and not (self._stopped and self._power_off)
        final = Mode.OFF if self._power_off else Mode.HOLDING
        return robot.mode in (final, Mode.FAULT, Mode.OFF) or self._elapsed_s > PATIENCE_S
