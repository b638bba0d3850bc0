"""How well arms are identified that nobody has been told of, and what their servos gain by it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import ClassVar, Final, Literal

import numpy as np
from numpy.typing import NDArray

from qrobot.config import Robot, load_robot
from qrobot.config.identified import with_model
from qrobot.ident.base import base_of_robot
from qrobot.ident.model import Identified
from qrobot.ident.plan import POSES, Plan, make_plan
from qrobot.ident.regressor import gravity_regressor, known_parameters
from qrobot.ident.result import model_of
from qrobot.ident.session import identify_log
from qrobot.rig.identify import record_lockstep
from qrobot.rig.unknown import UnknownArm
from qrobot.servo.settings import ServoSettings
from qrobot.study.journey import journey
from qrobot.study.study import Outcome, Study, kept

Floats = NDArray[np.float64]

TRIED: Final = 500  # poses that were not recorded, at which gravity is compared
Torque = Literal["known", "unknown"]

DATE: Final = "2026-01-01"  # of the models: a study's are thrown away


@dataclass(frozen=True)
class IdentificationStudy(Study):
    """Each arm makes the motions of a plan, is identified from them, and is judged against the truth.

    Attributes:
        poses: of the plan.
        torque: what the motors really give was measured, and stands in the robot file, or is to be found too.
        tracking: also let it make the paper's experiment, with the robot file, with what was found, and with the truth.
        stiction: friction at rest over Coulomb friction; 1 is no stiction.
    """

    kind: ClassVar[str] = "identification"
    poses: int = POSES
    torque: Torque = "unknown"
    tracking: bool = True
    stiction: float = 1.0

    def judge(self, seed: int) -> Outcome:
        """Errors of gravity and friction, every value's error in its own deviations, and tracking errors.

        Raises:
            QRobotError: the arm could not be moved, or its motion does not determine a model.
        """
        arm, plan = UnknownArm.drawn(self.robot, seed, True, self.stiction), _plan(self.robot_file, self.poses)
        measured = self.torque == "known"
        believed = arm.with_known_torque(self.robot) if measured else self.robot
        settings = ServoSettings(rate_hz=self.rate_hz)
        rows = record_lockstep(believed, self.robot_file, settings, arm.emulator(), plan)
        found = identify_log(believed, rows, settings.period_ns * 1e-9, known_torque=measured)
        outcome = {"payload_kg": kept(arm.payload_kg)} | compared(arm, found, seed)
        if self.tracking:
            identified = with_model(believed, model_of(found, rows, DATE))
            outcome["tracking"] = self._tracked(arm, {"before": believed, "after": identified, "exact": arm.told})
        return outcome

    def _tracked(self, arm: UnknownArm, beliefs: dict[str, Robot]) -> Outcome:
        """Rms errors by joint, by what the servo believes."""
        settings = ServoSettings(rate_hz=self.rate_hz)
        return {
            name: kept(journey(robot, self.robot_file, settings, arm.emulator()).rms) for name, robot in beliefs.items()
        }


@cache
def _plan(robot_file: str, poses: int) -> Plan:
    """What all arms of a study do; each process makes it once."""
    robot = load_robot(robot_file)
    regressor = gravity_regressor(robot)
    return make_plan(robot, regressor, base_of_robot(robot, regressor), poses)


def compared(arm: UnknownArm, found: Identified, seed: int) -> Outcome:
    """What was found, against the truth.

    Returns:
        gravity_before, gravity_rms: error of the robot file and of the model at random poses, N m (N), by joint.
        friction_error: of viscous and Coulomb friction as a share of the truth, by motor.
        deviations: error of each value by name, in its own standard deviations.
    """
    regressor, base, robot = found.regressor, found.base, found.robot
    truth = arm.truth(found.unknowns)
    friction = found.unknowns.parts(truth).friction
    q = np.random.default_rng(seed).uniform(robot.limits.q_min, robot.limits.q_max, (TRIED, robot.n))
    before = base.columns(regressor(q)) @ base.K @ known_parameters(robot, regressor)
    held = arm.gravity(found, q)
    error = found.fit.values - truth
    names = [value.name for value in found.values]
    deviations = error / np.sqrt(np.diag(found.fit.covariance))
    return {
        "gravity_before": kept(_rms(before - held)),
        "gravity_rms": kept(_rms(found.gravity(q) - held)),
        "friction_error": kept(found.friction / friction - 1.0),
        "deviations": dict(zip(names, kept(deviations), strict=True)),
    }


def _rms(values: Floats) -> Floats:
    return np.asarray(np.sqrt((values**2).mean(axis=0)))
