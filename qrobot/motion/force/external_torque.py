"""External torque, which the joints exert on the world: commanded less gravity, inertia and friction (B-06).

    exerted = tau - ID(q, v, a) - F(v)

with v and a of the servo's reference, because the friction the servo makes up for is that of the reference too. What is
left is what the feedback had to add, whoever resists.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.model.dynamics import (
    dynamics_params,
    dynamics_work,
    friction_params,
    friction_torque,
    gravity_torque,
    inverse_dynamics,
    with_payload,
)
from qrobot.model.stiction_compensation import PUSH_SHARE, added_at_rest, push_for
from qrobot.model.transmission import motor_to_torque, torque_to_motor, transmission_params
from qrobot.motion.path.setpoint_history import DEPTH, motion_of

# Share of its friction by which a moving joint may be wrong [A]: sources differ by more, one arm over a day by less.
MOVING_SHARE: Final = 0.2
_HINTED: Final = 1.5  # times its speed over that within which friction grows, a plan tells its way; 1 in full [A]
_AVERAGED: Final = 3  # samples


@dataclass(frozen=True, eq=False)
class ArmSample:
    """The robot at one sample. Shapes (n,), joint units.

    Attributes:
        q, v: measured position and velocity.
        tau: commanded torque.
        reference: where the servo wants the joints.
    """

    q: Floats
    v: Floats
    tau: Floats
    reference: Floats


@dataclass(frozen=True, eq=False)
class Exerted:
    """Torques that the joints exert on the world. Shapes (n,), N m (N).

    Attributes:
        torque: the estimate.
        uncertainty: by how much friction may falsify it: all of it on a joint that stands, a share on one that moves.
    """

    torque: Floats
    uncertainty: Floats


class DriveFriction:
    """Friction of the drives as the joints feel it.

    Args:
        robot: the arm, with the friction preset its servo works with.
    """

    def __init__(self, robot: Robot) -> None:
        self._params = friction_params(robot)
        self._transmission = transmission_params(robot)
        self._stiction = robot.friction[robot.control.friction_preset].stiction_factor

    def torque(self, v: Floats) -> Floats:
        """Torque lost at joint velocities `v`. Shapes (n,)."""
        motor = np.empty(v.size)
        friction_torque(self._rates(v), self._params, motor)
        return self._joints(motor)

    def uncertainty(self, v: Floats) -> Floats:
        """Bound of the error of `torque(v)`. Shapes (n,)."""
        rates = self._rates(v)
        motor = np.empty(v.size)
        friction_torque(rates, self._params, motor)
        stands = np.abs(rates) < self._params.velocity
        largest = np.maximum(self._params.coulomb_pos, self._params.coulomb_neg)
        return np.abs(self._joints(np.where(stands, self._stiction * largest, MOVING_SHARE * np.abs(motor))))

    def added(self, push: Floats) -> Floats:
        """Torque that the servo adds beyond gravity to torque setpoints, `push`, of joints that stand. Shapes (n,)."""
        return self._joints(added_at_rest(self._motors(push), self._params))

    def setpoint(self, total: Floats, v: Floats) -> Floats:
        """Torque setpoints that amount to `total` with what the servo adds at velocity `v`, if they stand. Shapes (n,).

        For a joint that moves that is `total` itself: its friction is made up for whatever the setpoint.
        """
        motor = self._motors(total)
        moving = self._moving(v)
        return self._joints(moving * motor + (1.0 - moving) * push_for(motor, self._params))

    def hint(self, v: Floats, planned: Floats) -> Floats:
        """Torques that tell the servo which way joints that stand at `v` are to go by their plan. Shapes (n,).

        A tenth of Coulomb friction, from which on the servo adds what it adds on a joint that stands.
        """
        p = self._params
        direction = np.clip(_HINTED * self._rates(planned) / p.velocity, -1.0, 1.0)
        coulomb = np.where(direction > 0.0, p.coulomb_pos, p.coulomb_neg)
        return self._joints(PUSH_SHARE * direction * coulomb * (1.0 - self._moving(v)))

    def _moving(self, v: Floats) -> Floats:
        """Share to which the servo's friction of motion has come up on the motors, 0 to 1. Shapes (n,)."""
        return np.clip(np.abs(self._rates(v)) / self._params.velocity, 0.0, 1.0)

    def _motors(self, tau: Floats) -> Floats:
        motor = np.empty(tau.size)
        torque_to_motor(tau, self._transmission, motor)
        return motor

    def _rates(self, v: Floats) -> Floats:
        rates: Floats = self._transmission.motor_per_joint @ v
        return rates

    def _joints(self, motor: Floats) -> Floats:
        joints = np.empty(motor.size)
        motor_to_torque(np.ascontiguousarray(motor), self._transmission, joints)
        return joints


class ExternalTorque:
    """Estimates what one arm exerts.

    Args:
        robot: the arm.
        period_s: sample period.
    """

    def __init__(self, robot: Robot, period_s: float) -> None:
        self._dynamics = self._bare = dynamics_params(robot)
        self._flange = np.array([0.0, 0.0, robot.geometry.flange_m])
        self._work = dynamics_work(robot.n)
        self.friction = DriveFriction(robot)
        self._period_s = period_s
        self._samples: deque[tuple[int, ArmSample]] = deque(maxlen=DEPTH + _AVERAGED - 1)
        self._torques: dict[int, Floats] = {}  # of the samples averaged last
        self._known: Exerted | None = None  # of the newest sample, once somebody has asked

    def carry(self, mass: float, centre: Floats, inertia: Floats) -> None:
        """Reckon with a payload, its centre in the frame of the flange; see `model.dynamics.with_payload`."""
        self._dynamics = with_payload(self._bare, mass, self._flange + centre, inertia)

    def gravity(self, q: Floats) -> Floats:
        """Torques that carry the arm at `q`. Shapes (n,)."""
        tau = np.empty(q.size)
        gravity_torque(q, self._dynamics, self._work, tau)
        return tau

    def observe(self, sample: ArmSample, tick: int) -> None:
        """Keep what was seen at sample `tick`; nothing is computed before somebody asks."""
        self._samples.append((tick, sample))
        self._known = None

    def estimate(self) -> Exerted | None:
        """The estimate at the newest sample, over three of them; None before the first."""
        if self._known is None and self._samples:
            samples = list(self._samples)
            self._torques = {samples[k][0]: self._torque_at(samples, k) for k in range(len(samples))[-_AVERAGED:]}
            _, v, _ = self._motion(samples[-DEPTH:])
            self._known = Exerted(np.mean(list(self._torques.values()), axis=0), self.friction.uncertainty(v))
        return self._known

    def _torque_at(self, samples: list[tuple[int, ArmSample]], k: int) -> Floats:
        """External torque at one of the samples, computed once. Shape (n,)."""
        known = self._torques.get(samples[k][0])
        return self._exerted(samples[max(0, k + 1 - DEPTH) : k + 1]) if known is None else known

    def _motion(self, samples: list[tuple[int, ArmSample]]) -> Floats:
        """Position, velocity and acceleration of the reference at the newest of a few samples. Shape (3, n)."""
        return motion_of([(tick, sample.reference) for tick, sample in samples], self._period_s)

    def _exerted(self, samples: list[tuple[int, ArmSample]]) -> Floats:
        """tau - ID - F at the newest of a few samples. Shape (n,)."""
        _, v, a = self._motion(samples)
        sample, model = samples[-1][1], np.empty(self._work.shape[0] // 4)
        inverse_dynamics(sample.q, v, a, self._dynamics, self._work, model)
        torque: Floats = sample.tau - model - self.friction.torque(v)
        return torque
