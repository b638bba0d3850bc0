"""Energy and inertia of an arm from the control-side model: the oracle for plants."""

from __future__ import annotations

import numpy as np

from qrobot.arrays import Floats
from qrobot.model.dynamics import DynamicsParams, dynamics_work, gravity_torque, inverse_dynamics


def model_torque(params: DynamicsParams, q: Floats, v: Floats, a: Floats) -> Floats:
    """Torques of the model's recursive Newton-Euler. Shape (n,)."""
    tau = np.zeros(q.size)
    inverse_dynamics(q, v, a, params, dynamics_work(q.size), tau)
    return tau


def model_mass_matrix(params: DynamicsParams, q: Floats) -> Floats:
    """M column by column: torques of unit accelerations at rest, less gravity's. Shape (n, n)."""
    still, gravity = np.zeros(q.size), np.zeros(q.size)
    gravity_torque(q, params, dynamics_work(q.size), gravity)
    return np.array([model_torque(params, q, still, unit) - gravity for unit in np.eye(q.size)]).T


def potential_gain(params: DynamicsParams, begin: Floats, end: Floats, pieces: int = 200) -> float:
    """Work against gravity from `begin` to `end`: gravity's torques integrated along the straight line (Simpson)."""
    points = np.linspace(0.0, 1.0, 2 * pieces + 1)
    tau, slope, work = np.zeros(begin.size), np.zeros(points.size), dynamics_work(begin.size)
    for k, s in enumerate(points):
        gravity_torque(begin + s * (end - begin), params, work, tau)
        slope[k] = tau @ (end - begin)
    weights = np.ones(points.size)
    weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
    return float(weights @ slope / (6.0 * pieces))
