"""The arm's dynamics as expressions, against the model's kernels, which were written independently."""

from __future__ import annotations

import casadi
import numpy as np
import pytest
from numpy.typing import NDArray

from qrobot.codegen.rigid_body import forward_dynamics, inverse_dynamics, mass_matrix, serial_arm, solve_positive
from qrobot.config import Robot, load_robot
from qrobot.model.dynamics import dynamics_params, with_payload
from tests.support.dynamics import model_mass_matrix, model_torque

PUMA, STANFORD = load_robot("puma560"), load_robot("stanford")
_SKEWED = PUMA.geometry.model_copy(
    update={
        "gravity_m_s2": np.array([3.0, -4.0, -8.0]),
        "alpha_rad": PUMA.geometry.alpha_rad + 0.3,
        "theta_rad": np.array([0.1, -0.2, 0.3, 0.4, -0.5, 0.6]),
    }
)
SKEWED = PUMA.model_copy(update={"geometry": _SKEWED})  # no angle a quarter turn, gravity tilted
ROBOTS = pytest.mark.parametrize("robot", [PUMA, STANFORD, SKEWED], ids=["puma560", "stanford", "skewed"])
N = 6


def symbols() -> tuple[casadi.SX, ...]:
    return tuple(casadi.SX.sym(name, N) for name in ("q", "v", "a"))


def random_states(robot: Robot, count: int = 20) -> NDArray[np.float64]:
    """Positions within limits, velocities and accelerations. Shape (count, 3, n)."""
    random = np.random.default_rng(7)
    q = random.uniform(robot.limits.q_min, robot.limits.q_max, (count, robot.n))
    return np.stack([q, random.normal(size=q.shape), random.normal(size=q.shape)], axis=1)


@ROBOTS
def test_inverse_dynamics_is_the_models(robot: Robot) -> None:
    q, v, a = symbols()
    tau = inverse_dynamics(serial_arm(robot), q, v, a, casadi.SX(robot.geometry.gravity_m_s2))
    function, params = casadi.Function("tau", [q, v, a], [tau]), dynamics_params(robot)
    for state in random_states(robot):
        np.testing.assert_allclose(np.array(function(*state)).ravel(), model_torque(params, *state), atol=1e-11)


@ROBOTS
def test_the_mass_matrix_is_the_models_symmetric_and_positive_definite(robot: Robot) -> None:
    q, _, _ = symbols()
    function, params = casadi.Function("M", [q], [mass_matrix(serial_arm(robot), q)]), dynamics_params(robot)
    for position, _, _ in random_states(robot):
        M = np.array(function(position))
        np.testing.assert_allclose(M, model_mass_matrix(params, position), atol=1e-11)
        np.testing.assert_array_equal(M, M.T)
        assert (np.linalg.eigvalsh(M) > 0.0).all()


@ROBOTS
def test_forward_dynamics_undoes_inverse_dynamics(robot: Robot) -> None:
    q, v, tau = symbols()
    gravity = casadi.SX(robot.geometry.gravity_m_s2)
    function = casadi.Function("a", [q, v, tau], [forward_dynamics(serial_arm(robot), q, v, tau, gravity)])
    params = dynamics_params(robot)
    for position, velocity, acceleration in random_states(robot):
        torque = model_torque(params, position, velocity, acceleration)
        result = np.array(function(position, velocity, torque)).ravel()
        np.testing.assert_allclose(result, acceleration, atol=1e-10)


@ROBOTS
def test_a_load_at_the_last_link_is_the_models(robot: Robot) -> None:
    q, v, a = symbols()
    at = [0.02, -0.03, 0.1]
    mass = casadi.SX.sym("mass")
    tau = inverse_dynamics(serial_arm(robot).holding(mass, at), q, v, a, casadi.SX(robot.geometry.gravity_m_s2))
    function = casadi.Function("tau", [q, v, a, mass], [tau])
    params = with_payload(dynamics_params(robot), 2.5, np.array(at))
    for state in random_states(robot):
        np.testing.assert_allclose(np.array(function(*state, 2.5)).ravel(), model_torque(params, *state), atol=1e-11)


@pytest.mark.parametrize("n", [1, 2, 5, 8])
def test_a_positive_definite_system_is_solved(n: int) -> None:
    random = np.random.default_rng(n)
    root = random.normal(size=(n, n))
    M, b = root @ root.T + 0.1 * np.eye(n), random.normal(size=n)
    x = np.array(casadi.DM(solve_positive(casadi.SX(M), casadi.SX(b)))).ravel()
    np.testing.assert_allclose(M @ x, b, atol=1e-10)


def test_quarter_turns_and_zero_lengths_cost_nothing() -> None:
    """The PUMA's twists are quarter turns: well under two thirds of the operations of an arm with none."""
    q, v, tau = symbols()
    gravity = casadi.SX([0.0, 0.0, -9.81])
    counts = [
        casadi.Function("a", [q, v, tau], [forward_dynamics(serial_arm(robot), q, v, tau, gravity)]).n_instructions()
        for robot in (PUMA, SKEWED)
    ]
    assert counts[0] < 0.65 * counts[1]
