"""Study of identification: the errors of models of arms drawn at random, and their servos' gain by them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import ClassVar, Final, Literal

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot, load_robot
from qrobot.config.identified import with_model
from qrobot.ident.base import base_of_robot
from qrobot.ident.excitation import Excitation, make_excitation
from qrobot.ident.inertia import InertialModel
from qrobot.ident.model import Identified
from qrobot.ident.plan import POSES, ExcitationPlan, make_plan
from qrobot.ident.regressor import gravity_regressor, inertial_regressor, known_parameters
from qrobot.ident.result import model_of
from qrobot.ident.session import identify_log, inertia_of_log
from qrobot.ident.unknowns import LEAST_FRICTION
from qrobot.rig.identify import record_lockstep
from qrobot.rig.perturbed_arm import PerturbedArm
from qrobot.servo.memory.telemetry import Rows
from qrobot.servo.settings import ServoSettings
from qrobot.study.study import ArmResult, Study, kept
from qrobot.study.tracking_run import track_experiment

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
        dynamic: also let it make the fast runs that tell inertia, which is then part of what was found.
    """

    kind: ClassVar[str] = "identification"
    poses: int = POSES
    torque: Torque = "unknown"
    tracking: bool = True
    stiction: float = 1.0
    dynamic: bool = False

    def judge(self, seed: int) -> ArmResult:
        """Errors of gravity and friction, every value's error in its own deviations, and tracking errors.

        Raises:
            QRobotError: the arm could not be moved, or its motion does not determine a model.
        """
        arm, measured = PerturbedArm.drawn(self.robot, seed, True, self.stiction), self.torque == "known"
        believed = arm.with_known_torque(self.robot) if measured else self.robot
        rows, period_s = self._recorded(arm, believed, _plan(self.robot_file, self.poses))
        found = identify_log(believed, rows, period_s, known_torque=measured)
        outcome = {"payload_kg": kept(arm.payload_kg)} | compared(arm, found, seed)
        inertial = None
        if self.dynamic:
            inertial = inertia_of_log(found, *self._recorded(arm, believed, _runs(self.robot_file)))
            outcome["inertia"] = inertia_compared(arm, inertial, measured)
        if self.tracking:
            identified = with_model(believed, model_of(found, rows, DATE, inertial))
            outcome["tracking"] = self._tracked(arm, {"before": believed, "after": identified, "exact": arm.told})
        return outcome

    def _recorded(self, arm: PerturbedArm, believed: Robot, plan: ExcitationPlan | Excitation) -> tuple[Rows, float]:
        """Telemetry of the moves of a plan, and its period."""
        settings = ServoSettings(rate_hz=self.rate_hz)
        rows = record_lockstep(believed, self.robot_file, settings, arm.emulator(), plan)
        return rows, settings.period_ns * 1e-9

    def _tracked(self, arm: PerturbedArm, beliefs: dict[str, Robot]) -> ArmResult:
        """Rms errors by joint, by what the servo believes."""
        settings = ServoSettings(rate_hz=self.rate_hz)
        return {
            name: kept(track_experiment(robot, self.robot_file, settings, arm.emulator()).rms)
            for name, robot in beliefs.items()
        }


@cache
def _plan(robot_file: str, poses: int) -> ExcitationPlan:
    """Plan of all arms of a study; each process makes it once."""
    robot = load_robot(robot_file)
    regressor = gravity_regressor(robot)
    return make_plan(robot, regressor, base_of_robot(robot, regressor), poses)


@cache
def _runs(robot_file: str) -> Excitation:
    """Fast runs of all arms of a study; each process makes them once."""
    robot = load_robot(robot_file)
    regressor = inertial_regressor(robot)
    return make_excitation(robot, regressor, base_of_robot(robot, regressor))


def compared(arm: PerturbedArm, found: Identified, seed: int) -> ArmResult:
    """Compare a model with the true arm.

    Returns:
        gravity_before, gravity_rms: error of the robot file and of the model at random poses, N m (N), by joint.
        friction_error: of viscous and Coulomb friction as a share of the truth, or of `LEAST_FRICTION`, by motor.
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
        "friction_error": kept((found.friction - friction) / np.maximum(friction, LEAST_FRICTION)),
        "deviations": dict(zip(names, kept(deviations), strict=True)),
    }


def inertia_compared(arm: PerturbedArm, inertial: InertialModel, measured: bool) -> ArmResult:
    """Compare the inertia found by fast runs with the true arm's.

    Where torque was not `measured`, nothing is in the unit of the truth, because of the rotors, and only errors tell.

    Returns:
        before, after: error of the torque predicted for runs held back, N m (N), by motor.
        deviations: error of each base parameter by name, in its own standard deviations; none without the unit.
    """
    truth = inertial.base.K @ known_parameters(arm.told, inertial.regressor)
    certain = np.sqrt(np.diag(inertial.fit.covariance))[: truth.size]
    deviations = kept((inertial.beta - truth) / certain)
    return {
        "before": kept(inertial.before_rms),
        "after": kept(inertial.held_back_rms),
        "deviations": dict(zip(inertial.base.leaders, deviations, strict=True)) if measured else {},
    }


def _rms(values: Floats) -> Floats:
    return np.asarray(np.sqrt((values**2).mean(axis=0)))
