"""Feedback of the laws of `servo.laws.impedance`, as matrices at each pose, for the check of stability."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.model.arm import Arm
from qrobot.model.inertia import mass_matrices, sample_poses
from qrobot.servo.laws.impedance import (
    CARTESIAN,
    DAMPED_REACH,
    DAMPED_SHARE,
    JOINT_FIRST,
    N_SPRINGS,
    NULL,
    REACH,
    TURN,
    ZETA,
    X,
    joint_settings,
)
from qrobot.servo.laws.law import KP, M0, Setting


def maybe_feedback(robot: Robot, law: str, chosen: Mapping[str, float], gains: Floats) -> tuple[Floats, Floats] | None:
    """(Kp, Kv) of an impedance law with the settings `chosen` by name, and `gains` (3, n); None for any other law.

    Those of `joint_impedance` have shape (n,), those of `cartesian_impedance` one matrix for each pose and load of
    `mass_matrices`, (m, n, n).
    """
    if law == "joint_impedance":
        return joint_feedback(robot, _numbers(joint_settings(robot), chosen), gains)
    if law == "cartesian_impedance":
        return cartesian_feedback(robot, _numbers(CARTESIAN, chosen), gains)
    return None


def _numbers(settings: tuple[Setting, ...], chosen: Mapping[str, float]) -> Floats:
    return np.array([chosen.get(setting.name, setting.default) for setting in settings])


def joint_feedback(robot: Robot, numbers: Floats, gains: Floats) -> tuple[Floats, Floats]:
    """(Kp, Kv), shapes (n,), of `joint_impedance` with these settings."""
    kp = numbers[JOINT_FIRST : JOINT_FIRST + robot.n]
    return kp, _damping(numbers, kp, gains)


def cartesian_feedback(robot: Robot, numbers: Floats, gains: Floats) -> tuple[Floats, Floats]:
    """(Kp, Kv), shapes (m, n, n), of `cartesian_impedance` with these settings."""
    jacobians = tip_jacobians(robot, float(numbers[REACH]))
    springs = np.concatenate((numbers[X : X + N_SPRINGS], np.repeat(numbers[TURN], 2)))
    null = numbers[NULL] * gains[KP]
    pull = np.einsum("mki,k,mkj->mij", jacobians, springs, jacobians)
    damping = _damping(numbers, np.einsum("mii->mi", pull) + null, gains)
    kp, kv = pull + _null_share(jacobians) * null, damping[:, :, None] * np.eye(robot.n)
    loads = len(mass_matrices(robot)) // len(kp)
    return np.tile(kp, (loads, 1, 1)), np.tile(kv, (loads, 1, 1))


def _damping(numbers: Floats, felt: Floats, gains: Floats) -> Floats:
    return np.asarray(2.0 * numbers[ZETA] * np.sqrt(np.maximum(felt, DAMPED_SHARE * gains[KP]) * gains[M0]))


def tip_jacobians(robot: Robot, reach: float) -> Floats:
    """Velocity of the tip in the base frame for each joint's, at the poses of `sample_poses`. Shape (m, 6, n)."""
    arm, offset = Arm(robot), np.array([0.0, 0.0, robot.geometry.flange_m + reach])
    jacobians = []
    for q in sample_poses(robot):
        J = arm.jacobian(q).copy()
        J[:3] += np.cross(J[3:].T, arm.forward(q)[:3, :3] @ offset).T
        jacobians.append(J)
    return np.array(jacobians)


def _null_share(jacobians: Floats) -> Floats:
    """N = 1 - J' (J J' + r^2)^-1 J, see `cartesian_impedance`. Shape (m, n, n)."""
    across = jacobians.transpose(0, 2, 1)
    inner = np.linalg.solve(jacobians @ across + DAMPED_REACH**2 * np.eye(6), jacobians)
    return np.asarray(np.eye(jacobians.shape[2]) - across @ inner)
