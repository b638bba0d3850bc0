"""The load in the hand, estimated while an arm moves: recursive least squares that forget, as CasADi expressions.

What the joints give beyond the model is linear in mass and first moments of the load, in the axes of the last frame:

    missing = columns theta,    theta = (m, hx, hy, hz)

Each cycle adds what it tells to the sums A = sum w c c' and b = sum w c y over the joints that move, older ones count
less, and theta solves (A + A0) theta = b (Ljung 1999, chapter 11, in information form). A0 says how heavy a load may be
before anything is known; it holds theta at none where motion tells nothing, so forgetting does not wind up. Time counts
while something moves: an arm at rest holds with any torque within its stiction, and neither learns nor forgets.

Importing this module loads CasADi.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import casadi
import numpy as np

from qrobot.codegen.rigid_body import RigidBody, SerialArm, inverse_dynamics, solve_positive
from qrobot.config import Robot

SX = Any  # casadi.SX, which has no types

OF_LOAD: Final = 4  # mass, first moments
LIKELY_KG: Final = 2.5  # what a hand may hold, Unimation's figure for a PUMA 560
LIKELY_M: Final = 0.1  # of its centre from the flange [A]
MOVES: Final = 0.06  # of a joint's greatest speed: below, friction falls with speed (Stribeck)
FRICTION_DOUBT: Final = 0.1  # of Coulomb friction: what an identification leaves open, at most
TORQUE_DOUBT: Final = 0.005  # of the greatest torque, for all else [A]


@dataclass(frozen=True)
class Estimate:
    """Expressions of what is known of the load.

    Attributes:
        sums: A and b. Shape (14,).
        theta: kg, kg m. Shape (4,).
        spread: standard deviation of each. Shape (4,).
    """

    sums: SX
    theta: SX
    spread: SX


def load_step(robot: Robot, arm: SerialArm, q: SX, v: SX, a: SX, friction: SX, tau: SX, sums: SX, pace: SX) -> Estimate:
    """The estimate after one more cycle.

    Args:
        robot, arm: what is believed of the arm, its friction included.
        q: measured position (n). v, a: desired velocity and acceleration (n), which an encoder's steps do not disturb.
        friction: what the drives lose at `v`, joint side (n).
        tau: torques that acted until now (n).
        sums: before (14).
        pace: length of the cycle in s, and the seconds of motion after which it counts by 1/e (2).
    """
    gravity = casadi.SX(robot.geometry.gravity_m_s2)
    missing = tau - inverse_dynamics(arm, q, v, a, gravity) - friction
    columns = load_columns(arm, q, v, a, gravity)
    moves = casadi.fabs(v) > casadi.SX(MOVES * robot.limits.v_max)
    weight = moves * pace[0] / casadi.SX(doubt(robot)) ** 2  # errors last: a second of motion is one observation
    keep = casadi.if_else(casadi.sum1(moves) > 0, 1.0 - pace[0] / pace[1], 1.0)
    weighted = columns * casadi.repmat(weight, 1, OF_LOAD)
    told = casadi.vertcat(_lower(columns.T @ weighted), weighted.T @ missing)
    after = keep * sums + told
    return Estimate(after, *estimated(after))


def load_columns(arm: SerialArm, q: SX, v: SX, a: SX, gravity: SX) -> SX:
    """Torques of 1 kg and of 1 kg m along each axis at the origin of the last frame (n, 4); its inertia left out."""
    theta = casadi.SX.sym("theta", OF_LOAD)
    load = RigidBody(theta[0], theta[1:], casadi.SX(3, 3))
    return casadi.densify(casadi.jacobian(inverse_dynamics(_alone(arm, load), q, v, a, gravity), theta))


def payload_torque(arm: SerialArm, q: SX, v: SX, a: SX, gravity: Any, payload: SX) -> SX:
    """Torques for a payload alone, whose ten numbers are those of `servo.stages.payload` (n)."""
    xx, yy, zz, xy, xz, yz = casadi.vertsplit(payload[4:])
    inertia = casadi.vertcat(casadi.horzcat(xx, xy, xz), casadi.horzcat(xy, yy, yz), casadi.horzcat(xz, yz, zz))
    return inverse_dynamics(_alone(arm, RigidBody(payload[0], payload[1:4], inertia)), q, v, a, gravity)


def _alone(arm: SerialArm, load: RigidBody) -> SerialArm:
    """The arm without any mass but that of `load` on its last link."""
    nothing = RigidBody(0, casadi.SX(3, 1), casadi.SX(3, 3))
    return replace(arm, links=(nothing,) * (arm.n - 1) + (load,), armature=np.zeros((arm.n, arm.n)))


def doubt(robot: Robot) -> Any:
    """Standard deviation of what a moving joint gives beyond the model, N m (N). Shape (n,)."""
    friction = robot.friction[robot.control.friction_preset]
    coulomb = np.maximum(friction.coulomb_pos, friction.coulomb_neg)
    return FRICTION_DOUBT * coulomb + TORQUE_DOUBT * robot.guard.tau_max


def estimated(sums: SX) -> tuple[SX, SX]:
    """Load (4) and standard deviations (4) from the sums (14)."""
    likely = casadi.SX([LIKELY_KG] + [LIKELY_KG * LIKELY_M] * (OF_LOAD - 1))
    A, at = casadi.diag(1.0 / likely**2), 0
    for row in range(OF_LOAD):
        for column in range(row + 1):
            A[row, column] += sums[at]
            A[column, row] = A[row, column]
            at += 1
    variance = [solve_positive(A, casadi.SX.eye(OF_LOAD)[:, k])[k] for k in range(OF_LOAD)]
    return solve_positive(A, sums[at:]), casadi.sqrt(casadi.vertcat(*variance))


def _lower(A: SX) -> SX:
    return casadi.vertcat(*(A[row, column] for row in range(OF_LOAD) for column in range(row + 1)))
