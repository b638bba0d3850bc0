"""Inertia of a serial arm as its joints feel it: the mass matrix, at one pose or over the range of an arm."""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config.robot import Robot
from qrobot.model.dynamics import DynamicsParams, dynamics_params, dynamics_work, inverse_dynamics, with_payload

RANDOM_POSES: Final = 32  # [A] beside the named ones; three times as many change no extreme by more than 2 %
_SEED: Final = 560


def mass_matrix(params: DynamicsParams, q: Floats) -> Floats:
    """M(q), rotors included: torques of unit accelerations at rest, less those of gravity. Shape (n, n)."""
    n, work = q.size, dynamics_work(q.size)
    still, torques, weight = np.zeros(n), np.zeros((n, n)), np.zeros(n)
    inverse_dynamics(q, still, still, params, work, weight)
    for j, unit in enumerate(np.eye(n)):
        inverse_dynamics(q, still, unit, params, work, torques[j])
    matrix = torques - weight
    return np.asarray(0.5 * (matrix + matrix.T))


def sample_poses(robot: Robot) -> Floats:
    """Poses over the range of `robot`: the named ones and a fixed random draw from the joints' range. Shape (m, n)."""
    drawn = np.random.default_rng(_SEED).uniform(robot.limits.q_min, robot.limits.q_max, (RANDOM_POSES, robot.n))
    return np.concatenate((np.array(list(robot.poses.values())), drawn))


def mass_matrices(robot: Robot) -> Floats:
    """Mass matrices over the range of `robot`, with empty hand and with its payload at the flange. Shape (m, n, n).

    The poses are those of `sample_poses`, once for each load.
    """
    limits, empty, poses = robot.limits, dynamics_params(robot), sample_poses(robot)
    models = [empty]
    if limits.payload_kg > 0.0:
        models.append(with_payload(empty, limits.payload_kg, np.array([0.0, 0.0, robot.geometry.flange_m])))
    return np.array([mass_matrix(model, q) for model in models for q in poses])
