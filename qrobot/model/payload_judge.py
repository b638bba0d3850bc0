"""Judgement of what an arm can carry, in Python before a servo is asked to reckon with it."""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.model.dynamics import dynamics_params, dynamics_work, gravity_torque, with_payload

POSES: Final = 1024  # [A] over the range of the joints; the worst of them lies within 2 % of the worst there is
SEED: Final = 1
HOLDING_SHARE: Final = 0.9  # [A] of the greatest torque: the rest is for the worst pose, and for feedback
FARTHEST_M: Final = 1.0  # [A] of a centre of mass from the flange; farther is a mistake of units
WIDEST_M: Final = 1.0  # [A] radius of gyration of a load; wider is a mistake of units, such as kg cm2


class Load(Protocol):
    """Something that an arm carries."""

    @property
    def mass(self) -> float:
        """Mass, kg."""

    @property
    def centre(self) -> tuple[float, ...]:
        """Centre of mass in the frame of the flange, m. Shape (3,)."""

    @property
    def inertia(self) -> tuple[float, ...]:
        """Inertia about that centre, kg m2: xx yy zz xy xz yz. Shape (6,)."""


class PayloadJudge:
    """Judges payloads of one arm; what takes time, the weight of each pose, is computed once, here.

    Args:
        robot: the arm.

    Attributes:
        robot: as given.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        rng = np.random.default_rng(SEED)
        random = rng.uniform(robot.limits.q_min, robot.limits.q_max, (POSES, robot.n))
        poses = np.concatenate([random, np.array(list(robot.poses.values()))])
        self._bare = _holding(robot, poses, 0.0, np.zeros(3))
        self._mass = _holding(robot, poses, 1.0, np.zeros(3)) - self._bare
        self._moments = [_holding(robot, poses, 1.0, axis) - self._bare - self._mass for axis in np.eye(3)]
        self._offset = np.array([0.0, 0.0, robot.geometry.flange_m])

    def objection(self, payload: Load) -> str:
        """Reason for which the arm cannot carry `payload`; "" when it can."""
        robot, centre = self.robot, np.array(payload.centre)
        if not (np.isfinite([payload.mass, *payload.centre, *payload.inertia]).all() and payload.mass >= 0.0):
            return "a payload has a mass of 0 kg or more, a centre and an inertia that are finite numbers"
        if not np.abs(centre).max() <= FARTHEST_M:
            return f"a centre at {centre.tolist()} m is too far from the flange: {FARTHEST_M:g} m at most"
        if not _is_inertia(payload.inertia):
            return f"{list(payload.inertia)} is no inertia of a body: kg m2, xx yy zz xy xz yz about its centre"
        if not _largest_moment(payload.inertia) <= payload.mass * WIDEST_M**2:
            return (
                f"{list(payload.inertia)} kg m2 is too much for {payload.mass:g} kg: no principal moment may exceed "
                f"the mass times ({WIDEST_M:g} m)^2; is it in kg m2?"
            )
        most = robot.limits.payload_kg
        if most > 0.0 and not payload.mass <= most:
            return f"{payload.mass:g} kg is too heavy: {robot.name} carries {most:g} kg (payload_kg of its file)"
        return self._too_heavy(payload.mass, centre)

    def _too_heavy(self, mass: float, centre: Floats) -> str:
        """Objection where a joint could not hold the payload at some pose."""
        moments = mass * (centre + self._offset)
        tau = self._bare + mass * self._mass + sum(h * each for h, each in zip(moments, self._moments, strict=True))
        needed, there = np.abs(tau).max(axis=0), HOLDING_SHARE * self.robot.guard.tau_max
        if (needed <= there).all():
            return ""
        j = int(np.argmax(needed / there))
        unit = "N" if self.robot.prismatic[j] else "N m"
        return (
            f"{mass:g} kg at {centre.tolist()} m is too heavy: {self.robot.joint_names[j]} would have to hold "
            f"{needed[j]:.3g} {unit} at the worst pose, {there[j]:.3g} are there; carry less, or nearer to the flange"
        )


def _holding(robot: Robot, poses: Floats, mass: float, com: Floats) -> Floats:
    """Torques that hold the arm at `poses`, shape (m, n), with a mass in the frame of the last link. Shape (m, n)."""
    params, work, tau = with_payload(dynamics_params(robot), mass, com), dynamics_work(robot.n), np.zeros(poses.shape)
    for q, held in zip(poses, tau, strict=True):
        gravity_torque(q, params, work, held)
    return tau


def _is_inertia(numbers: tuple[float, ...]) -> bool:
    """A tensor of a body: none of its principal moments is negative, or larger than the two others together."""
    principal = _principal_moments(numbers)
    slack = 1e-9 * max(1.0, float(np.abs(principal).max()))
    return bool(principal[0] >= -slack and principal[2] - principal[1] <= principal[0] + slack)


def _largest_moment(numbers: tuple[float, ...]) -> float:
    """Largest principal moment, kg m2."""
    return float(_principal_moments(numbers)[-1])


def _principal_moments(numbers: tuple[float, ...]) -> Floats:
    """Principal moments of an inertia, kg m2, in rising order. Shape (3,)."""
    xx, yy, zz, xy, xz, yz = numbers
    return np.asarray(np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), dtype=np.float64)
