"""Torques as linear in link parameters, and which combinations of them can be told."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.config import Robot, load_robot
from qrobot.ident.base import base_of_robot, base_parameters
from qrobot.ident.regressor import gravity_regressor, inertial_regressor, known_parameters
from qrobot.model.dynamics import dynamics_params, dynamics_work, gravity_torque
from tests.support.dynamics import model_torque

PUMA, STANFORD = load_robot("puma560"), load_robot("stanford")
ROBOTS = pytest.mark.parametrize("robot", [PUMA, STANFORD], ids=["puma560", "stanford"])
G = 9.81


def random_positions(robot: Robot, count: int) -> np.ndarray:
    return np.random.default_rng(5).uniform(robot.limits.q_min, robot.limits.q_max, (count, robot.n))


def model_gravity(robot: Robot, q: np.ndarray) -> np.ndarray:
    tau, work = np.zeros(robot.n), dynamics_work(robot.n)
    gravity_torque(q, dynamics_params(robot), work, tau)
    return tau


@ROBOTS
def test_the_regressor_times_the_files_masses_is_the_models_gravity(robot: Robot) -> None:
    regressor, q = gravity_regressor(robot), random_positions(robot, 20)
    expected = [model_gravity(robot, position) for position in q]
    np.testing.assert_allclose(regressor(q) @ known_parameters(robot, regressor), expected, atol=1e-11)


def test_the_full_regressor_is_the_models_inverse_dynamics_less_the_rotors() -> None:
    regressor, params = inertial_regressor(PUMA), dynamics_params(PUMA)
    random = np.random.default_rng(6)
    q, v, a = random_positions(PUMA, 10), *random.normal(size=(2, 10, PUMA.n))
    expected = [model_torque(params, *state) - params.armature @ state[2] for state in zip(q, v, a, strict=True)]
    np.testing.assert_allclose(regressor(q, v, a) @ known_parameters(PUMA, regressor), expected, atol=1e-11)


def test_the_base_parameters_of_the_puma_are_armstrongs_gravity_constants() -> None:
    """Armstrong, Khatib and Burdick 1986: g1 .. g5 = -37.2, -8.44, 1.02, 0.249, -0.0282 N m."""
    regressor = gravity_regressor(PUMA)
    base = base_of_robot(PUMA, regressor)
    beta = dict(zip(base.leaders, G * base.K @ known_parameters(PUMA, regressor), strict=True))
    found = [-beta["hx2"], beta["hy3"], beta["hy2"], -beta["hx3"], beta["hy5"]]
    np.testing.assert_allclose(found, [-37.2, -8.44, 1.02, 0.249, -0.0282], rtol=5e-3)
    assert len(beta) == 10
    assert base.unseen == ("m1", "hx1", "hy1", "hz1", "m2", "hz2", "hz3")


def test_gravity_is_the_closed_form_of_the_literature() -> None:
    """tau2 = g1 c2 + g2 s23 + g3 s2 + g4 c23 + g5 (s23 c5 + c23 c4 s5), and so on outwards (AKB 1986)."""
    q = random_positions(PUMA, 50)
    _, q2, q3, q4, q5, _ = q.T
    g1, g2, g3, g4, g5 = -37.235, -8.454, 1.024, 0.2489, -0.02825
    c23, s23 = np.cos(q2 + q3), np.sin(q2 + q3)
    wrist = g5 * (s23 * np.cos(q5) + c23 * np.cos(q4) * np.sin(q5))
    tau3 = g2 * s23 + g4 * c23 + wrist
    tau5 = g5 * (c23 * np.sin(q5) + s23 * np.cos(q4) * np.cos(q5))
    zero = np.zeros_like(q2)
    tau4 = -g5 * s23 * np.sin(q4) * np.sin(q5)
    expected = np.column_stack([zero, g1 * np.cos(q2) + g3 * np.sin(q2) + tau3, tau3, tau4, tau5, zero])
    regressor = gravity_regressor(PUMA)
    np.testing.assert_allclose(regressor(q) @ known_parameters(PUMA, regressor), expected, atol=1e-3)


def test_the_puma_has_36_base_parameters_in_motion() -> None:
    """36 with gravity along the first axis (Mayeda, Yoshida and Osuka 1990)."""
    base = base_of_robot(PUMA, inertial_regressor(PUMA))
    assert len(base.leading) == 36
    assert base.combination(base.leaders.index("hx2")) == "hx2 + 0.4318 m3 + 0.4318 m4 + 0.4318 m5 + 0.4318 m6"


@ROBOTS
def test_base_parameters_tell_every_gravity_torque_with_independent_columns(robot: Robot) -> None:
    regressor, q = gravity_regressor(robot), random_positions(robot, 60)
    base, theta = base_of_robot(robot, regressor), np.random.default_rng(8).normal(size=len(regressor.names))
    columns = base.columns(regressor(q))
    np.testing.assert_allclose(columns @ (base.K @ theta), regressor(q) @ theta, atol=1e-10)
    assert np.linalg.matrix_rank(columns.reshape(-1, len(base.leading))) == len(base.leading)


def test_a_sliding_joint_weighs_what_hangs_on_it() -> None:
    base = base_of_robot(STANFORD, gravity_regressor(STANFORD))
    assert base.combination(base.leaders.index("m3")) == "m3 + m4 + m5 + m6"


def test_the_order_says_which_of_two_equal_columns_leads() -> None:
    W = np.array([[1.0, 2.0, 0.0], [0.0, 0.0, 0.0], [3.0, 6.0, 0.0]])
    assert base_parameters(W, "abc").combination(0) == "a + 2 b"
    second = base_parameters(W, "abc", order=[1, 0, 2])
    assert (second.combination(0), second.unseen) == ("b + 0.5 a", ("c",))
