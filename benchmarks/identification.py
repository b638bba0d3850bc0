"""How well arms are identified that nobody has been told of, in lock-step, one after the other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from qrobot.config import Robot
from qrobot.ident.base import base_of_robot
from qrobot.ident.model import Identified
from qrobot.ident.plan import make_plan
from qrobot.ident.regressor import gravity_regressor
from qrobot.ident.session import identify_log
from qrobot.rig.identify import record_lockstep
from qrobot.rig.unknown import UnknownArm
from qrobot.servo.settings import ServoSettings

POSES = 24
TRIED = 500  # poses at which gravity is compared


@dataclass(frozen=True)
class Verdict:
    """Of one arm. Errors of gravity in N m, rms over random poses, by joint; of friction as a share of the truth."""

    seed: int
    payload_kg: float
    gravity_rms: list[float]
    friction_error: float
    covered: float

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)


def study(arms: int, robot: Robot, poses: int = POSES) -> Iterator[Verdict]:
    """A verdict on each of so many arms."""
    regressor = gravity_regressor(robot)
    base = base_of_robot(robot, regressor)
    plan = make_plan(robot, regressor, base, poses)
    settings = ServoSettings(rate_hz=1000.0)
    for seed in range(arms):
        arm = UnknownArm.drawn(robot, seed)
        rows = record_lockstep(robot, robot.name, settings, arm.emulator(), plan)
        yield judged(seed, arm, identify_log(robot, rows, settings.period_ns * 1e-9))


def judged(seed: int, arm: UnknownArm, found: Identified) -> Verdict:
    """What was found, against the truth."""
    beta = found.base.K @ arm.parameters(found.regressor)
    truth = np.concatenate([beta, arm.friction.ravel()])
    limits = found.robot.limits
    q = np.random.default_rng(seed).uniform(limits.q_min, limits.q_max, (TRIED, found.robot.n))
    error = found.gravity(q) - found.base.columns(found.regressor(q)) @ beta
    return Verdict(
        seed,
        arm.payload_kg,
        np.sqrt((error**2).mean(axis=0)).tolist(),
        float(np.abs(found.friction / arm.friction - 1.0).max()),
        float(np.mean(np.abs(found.fit.values - truth) <= found.fit.half_width)),
    )


def summary(verdicts: list[Verdict]) -> dict[str, Any]:
    """Worst of all arms, by joint and over all, and how often an interval holds the truth."""
    gravity = np.array([verdict.gravity_rms for verdict in verdicts])
    return {
        "arms": len(verdicts),
        "worst_gravity_rms_Nm": gravity.max(axis=0).tolist(),
        "mean_gravity_rms_Nm": gravity.mean(axis=0).tolist(),
        "worst_friction_error": max(verdict.friction_error for verdict in verdicts),
        "covered": float(np.mean([verdict.covered for verdict in verdicts])),
        "each": [verdict.to_dict() for verdict in verdicts],
    }
