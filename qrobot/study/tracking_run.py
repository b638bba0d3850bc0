"""Tracking errors of an arm in the experiment of the QRobot paper, under any robot file that its servo believes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.modecodes import Mode
from qrobot.rig.fallen_arm import control_at_rest
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.memory.telemetry import Rows
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.wire.vocabulary import DEFAULT_PERIOD_US

SLOW: Final = 0.35  # rad/s of the fastest joint; the way back is three times as fast (QRobot paper, section 6)


@dataclass(frozen=True, eq=False)
class Tracked:
    """Errors of one run.

    Attributes:
        rms: of desired less measured position, rad (m). Shape (n,).
        largest: of the same. Shape (n,).
        chatter: rms change of the torque from cycle to cycle, as a share of the guard's limit. Shape (n,).
    """

    rms: Floats
    largest: Floats
    chatter: Floats


def track_experiment(believed: Robot, robot_file: str, settings: ServoSettings, emulator: Emulator) -> Tracked:
    """Move from park to the end position, and back at triple speed.

    Args:
        believed: the robot of the servo.
        robot_file: the robot of the program.
        settings: of the servo.
        emulator: the arm as it is.

    Raises:
        ServoFault: the servo stopped the arm.
    """
    rig = LockstepRig(believed, settings, emulator)
    with control_at_rest(rig, robot_file, DEFAULT_PERIOD_US) as arm:
        for pose, speed in (("park", SLOW), ("end", SLOW), ("park", 3.0 * SLOW)):
            arm.setjvel(speed)
            arm.move(arm.pose(pose))
            arm.waitfor(arm.completed)
    return _tracked(rig.rows(), believed)


def _tracked(rows: Rows, robot: Robot) -> Tracked:
    tracking = rows[rows["mode"] == Mode.TRACKING]
    error = tracking["q_ref"] - tracking["q"]
    change = np.diff(tracking["tau"], axis=0) / robot.guard.tau_max
    return Tracked(_rms(error), np.abs(error).max(axis=0), _rms(change))


def _rms(values: Floats) -> Floats:
    return np.asarray(np.sqrt((values**2).mean(axis=0)))
