"""Gravity, inertia and friction of the PUMA 560, against the published numbers."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.arrays import Floats
from qrobot.config import load_robot
from qrobot.model.dynamics import (
    DynamicsParams,
    dynamics_params,
    dynamics_work,
    friction_params,
    friction_torque,
    gravity_torque,
    inverse_dynamics,
    with_payload,
)

PUMA = load_robot("puma560")
PARAMS = dynamics_params(PUMA)
STANFORD = load_robot("stanford")
#: AKB 1986 print -37.2, -8.44, 1.02, 0.249, -0.0282; these follow from their masses and centres to the last digit.
G1, G2, G3, G4, G5 = -37.235, -8.454, 1.024, 0.2489, -0.02825


def gravity(q: Floats, params: DynamicsParams = PARAMS) -> Floats:
    tau = np.empty(q.size)
    gravity_torque(q, params, dynamics_work(q.size), tau)
    return tau


def torques(q: Floats, v: Floats, a: Floats, params: DynamicsParams = PARAMS) -> Floats:
    tau = np.empty(q.size)
    inverse_dynamics(q, v, a, params, dynamics_work(q.size), tau)
    return tau


def closed_form(q: Floats) -> Floats:
    """AKB 1986: gravity of joints 2 to 5 by five constants."""
    (s2, c2), (s23, c23) = (np.sin(q[1]), np.cos(q[1])), (np.sin(q[1] + q[2]), np.cos(q[1] + q[2]))
    s4, c4, s5, c5 = np.sin(q[3]), np.cos(q[3]), np.sin(q[4]), np.cos(q[4])
    tau3 = G2 * s23 + G4 * c23 + G5 * (s23 * c5 + c23 * c4 * s5)
    tau5 = G5 * (c23 * s5 + s23 * c4 * c5)
    return np.array([0, G1 * c2 + G3 * s2 + tau3, tau3, -G5 * s23 * s4 * s5, tau5, 0])


@pytest.mark.parametrize(
    ("pose", "joint_2", "joint_3", "joint_5"),
    [
        ("ready", -0.775, 0.249, 0.0),
        ("zero", -36.986, 0.249, 0.0),
        ("stretched", -45.717, -8.483, -0.028),
        ("park", -33.207, -6.154, 0.0),
    ],
)
def test_gravity_torques_in_known_poses(pose: str, joint_2: float, joint_3: float, joint_5: float) -> None:
    expected = [0, joint_2, joint_3, 0, joint_5, 0]
    np.testing.assert_allclose(gravity(PUMA.poses[pose]), expected, atol=6e-4)


def test_gravity_is_the_closed_form_of_armstrong_khatib_and_burdick() -> None:
    for q in np.random.default_rng(0).uniform(-np.pi, np.pi, (200, 6)):
        np.testing.assert_allclose(gravity(q), closed_form(q), atol=2e-3)


def test_the_five_gravity_constants_follow_from_the_link_table() -> None:
    """Read off at poses where one of them stands alone."""
    up, level = np.radians([0, -90, 90, 0, 0, 0]), np.zeros(6)
    g4 = gravity(level)[2]
    g1 = gravity(level)[1] - g4
    g3 = g4 - gravity(up)[1]
    g5 = gravity(np.radians([0, 0, 0, 0, 90, 0]))[4]
    g2 = gravity(np.radians([0, 0, 90, 0, 0, 0]))[2] - g5
    np.testing.assert_allclose([g1, g2, g3, g4, g5], [G1, G2, G3, G4, G5], atol=6e-4)
    np.testing.assert_allclose([g1, g2, g3, g4, g5], [-37.2, -8.44, 1.02, 0.249, -0.0282], rtol=5e-3)


@pytest.mark.parametrize(
    ("pose", "diagonal"),
    [
        ("ready", [2.34, 5.16, 0.913, 0.192, 0.177, 0.194]),
        ("zero", [3.92, 4.39, 0.913, 0.192, 0.177, 0.194]),
        ("stretched", [4.99, 5.16, 0.913, 0.192, 0.177, 0.194]),
    ],
)
def test_the_mass_matrix_has_the_published_diagonal(pose: str, diagonal: list[float]) -> None:
    """With Corke's rotors; joint 5 carries motor 6's rotor through the wrist coupling as well."""
    q = PUMA.poses[pose]
    M = np.array([torques(q, np.zeros(6), unit) for unit in np.eye(6)]) - gravity(q)
    np.testing.assert_allclose(np.diag(M), diagonal, rtol=0.006)
    np.testing.assert_allclose(M, M.T, atol=1e-12)
    assert np.linalg.eigvalsh(M).min() > 0


def test_rotors_couple_joints_5_and_6_by_a_fifth_of_joint_5s_own() -> None:
    assert PARAMS.armature[4, 5] == pytest.approx(0.035, abs=1e-3)
    assert PARAMS.armature[4, 4] == pytest.approx(0.177, abs=1e-3)
    np.testing.assert_allclose(np.diag(PARAMS.armature)[:4], [0.7840, 2.3248, 0.5769, 0.1908], rtol=1e-3)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_friction_at_one_radian_per_second_is_the_published_table(direction: float) -> None:
    viscous = np.array([5.802, 9.497, 3.980, 0.412, 0.427, 0.216])
    coulomb = {1.0: [24.73, 13.58, 7.09, 0.852, 0.666, 0.304], -1.0: [27.24, 7.65, 5.64, 1.285, 1.043, 0.805]}
    tau = np.empty(6)
    friction_torque(np.full(6, direction), friction_params(PUMA, "corke"), tau)
    np.testing.assert_allclose(tau, direction * (viscous + coulomb[direction]))


def test_corkes_friction_is_his_motor_side_values_through_the_gears() -> None:
    """Corke & Armstrong-Helouvry 1994: B and Tc at the motor."""
    gear = PUMA.transmission.gear
    friction = PUMA.friction["corke"]
    viscous = np.array([1.48e-3, 0.817e-3, 1.38e-3, 71.2e-6, 82.6e-6, 36.7e-6])
    np.testing.assert_allclose(friction.viscous, viscous * gear**2, rtol=2e-3)
    positive, negative = friction.coulomb_pos / gear, friction.coulomb_neg / gear
    np.testing.assert_allclose(positive, [0.395, 0.126, 0.132, 11.2e-3, 9.26e-3, 3.96e-3], rtol=3e-3)
    np.testing.assert_allclose(negative, [0.435, 0.071, 0.105, 16.9e-3, 14.5e-3, 10.5e-3], rtol=3e-3)


def test_friction_grows_without_a_step_through_standstill() -> None:
    params, speeds = friction_params(PUMA), np.linspace(-0.1, 0.1, 2001)
    tau = np.empty((speeds.size, 6))
    for v, row in zip(speeds, tau, strict=True):
        friction_torque(np.full(6, v), params, row)
    slope = np.maximum(params.coulomb_pos, params.coulomb_neg) / params.velocity + params.viscous
    growth = np.diff(tau, axis=0)
    assert (growth > 0).all()
    assert (growth <= slope * 1e-4 * (1 + 1e-9)).all()
    np.testing.assert_array_equal(tau[speeds == 0], 0)


def test_the_preset_is_the_one_the_robot_names_unless_another_is_asked_for() -> None:
    np.testing.assert_array_equal(friction_params(PUMA).coulomb_pos, PUMA.friction["corke"].coulomb_pos)
    np.testing.assert_array_equal(friction_params(PUMA, "akb").coulomb_pos, PUMA.friction["akb"].coulomb_pos)


def test_a_payload_at_the_wrist_centre_weighs_on_the_stretched_arm_at_its_reach() -> None:
    held = with_payload(PARAMS, 2.5, np.zeros(3))
    extra = gravity(PUMA.poses["stretched"], held) - gravity(PUMA.poses["stretched"])
    np.testing.assert_allclose(extra, -2.5 * 9.81 * np.array([0, 0.4318 + 0.4331, 0.4331, 0, 0, 0]), atol=1e-9)


def test_a_payload_does_not_change_the_arm_it_is_given_to() -> None:
    before = dynamics_params(PUMA)
    with_payload(PARAMS, 2.5, np.array([0, 0, 0.1]))
    for now, then in zip(PARAMS[1:], before[1:], strict=True):
        np.testing.assert_array_equal(now, then)


def test_a_sliding_joint_carries_the_weight_that_hangs_on_it() -> None:
    q = np.zeros(6)
    q[2] = 0.7
    hanging = gravity(q, dynamics_params(STANFORD))  # boom straight up
    assert hanging[2] == pytest.approx((4.25 + 1.08 + 0.63 + 0.51) * 9.81)


def test_default_gains_are_the_documented_bandwidths() -> None:
    """Kp = M0 wn^2, Kv = 2 M0 wn with wn = 30 rad/s on the arm and 50 on the wrist."""
    wn, control = np.array([30, 30, 30, 50, 50, 50]), PUMA.control
    np.testing.assert_allclose(control.kp, control.inertia * wn**2, rtol=2e-3)
    np.testing.assert_allclose(control.kv, 2 * control.inertia * wn, rtol=0.03)


def test_full_acceleration_stays_within_the_guards_torque() -> None:
    """limits.a_max is consistent with inertia, worst gravity and friction at top speed."""
    for robot in (PUMA, STANFORD):
        friction, params = np.empty(6), dynamics_params(robot)
        friction_torque(robot.limits.v_max, friction_params(robot), friction)
        rng = np.random.default_rng(0)
        worst = max_gravity(params, rng.uniform(robot.limits.q_min, robot.limits.q_max, (500, 6)))
        assert (robot.control.inertia * robot.limits.a_max + friction + worst <= robot.guard.tau_max).all()


def max_gravity(params: DynamicsParams, poses: Floats) -> Floats:
    worst: Floats = np.abs([gravity(q, params) for q in poses]).max(axis=0)
    return worst
