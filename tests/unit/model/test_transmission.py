"""Counters, joints, DAC codes and potentiometers of the PUMA 560, against the published numbers."""

from __future__ import annotations

import copy
import tomllib
from itertools import product

import numpy as np
import pytest

from qrobot.arrays import Floats, Ints
from qrobot.config import load_robot, robot_path
from qrobot.config.robot import robot_of
from qrobot.model.transmission import (
    TransmissionParams,
    count_word,
    counts_to_joint,
    dac_code,
    dac_to_motor_torque,
    joint_to_counts,
    joint_to_motor,
    motor_to_pot,
    motor_to_torque,
    signed_word,
    torque_to_dac,
    torque_to_motor,
    transmission_params,
    unwrap_counts,
)

ROBOT = load_robot("puma560")
PARAMS = transmission_params(ROBOT)
K45, K46, K56 = 0.0139037, -0.0130401, 0.180556  # TRC004 driver v4.2


def joints(counts: list[int], params: TransmissionParams = PARAMS) -> Floats:
    q = np.empty(6)
    counts_to_joint(np.array(counts), params, q)
    return q


def counters(q: Floats) -> Ints:
    counts = np.empty(6, dtype=np.int64)
    joint_to_counts(q, PARAMS, counts)
    return counts


def test_encoder_zero_is_the_val_ready_pose_with_joint_4_loaded_at_8000() -> None:
    np.testing.assert_allclose(np.degrees(joints([0, 0, 0, 8000, 0, 0])), [0, -90, 90, 0, 0, 0], atol=1e-12)
    assert list(counters(ROBOT.poses["ready"])) == [0, 0, 0, 8000, 0, 0]


@pytest.mark.parametrize(
    ("scales", "published"),
    [
        ("gear", [9964.9, 13727.4, 8547.6, 12101.6, 11446.9, 6102.5]),  # Unimation ratios
        ("vendor", [9965.1, 13669.4, 8547.0, 12097.3, 11444.8, 6106.1]),  # TRC004 encoderScale
    ],
)
def test_counts_per_radian_are_the_published_ones(scales: str, published: list[float]) -> None:
    document = copy.deepcopy(tomllib.loads(robot_path("puma560").read_text()))
    document["transmission"]["scales"] = scales
    rad_per_count = transmission_params(robot_of(document, "x")).rad_per_count
    np.testing.assert_allclose(np.abs(1 / rad_per_count), published, atol=0.06)
    assert list(np.sign(rad_per_count)) == [1, -1, 1, -1, -1, -1]


def test_counts_per_degree_are_unimations_with_all_signs_turned() -> None:
    per_degree = np.radians(1) / PARAMS.rad_per_count
    np.testing.assert_allclose(per_degree, [173.92, -239.59, 149.18, -211.21, -199.79, -106.51], rtol=5e-5)


def test_the_wrist_couples_as_in_the_vendors_driver() -> None:
    counts = np.array([100, -200, 300, 8400, -500, 600])
    r = PARAMS.rad_per_count * (counts - [0, 0, 0, 8000, 0, 0])
    expected = r + np.radians([0, -90, 90, 0, 0, 0])
    expected[5] = r[5] - K46 * r[3] - K56 * r[4]  # the raw r5, not q5
    expected[4] = r[4] - K45 * r[3]
    np.testing.assert_allclose(joints(list(counts)), expected, atol=1e-15)


def test_the_coupling_matrix_is_the_inverse_of_the_vendors_form() -> None:
    wrist = PARAMS.motor_per_joint[3:, 3:]
    np.testing.assert_allclose(wrist, [[1, 0, 0], [0.0139037, 1, 0], [-0.0105297, 0.180556, 1]], atol=5e-8)
    np.testing.assert_allclose(PARAMS.motor_per_joint[:3, :3], np.eye(3))


def test_every_corner_of_the_joint_ranges_fits_signed_words_but_joint_4_would_not_without_its_offset() -> None:
    low, high = ROBOT.limits.q_min, ROBOT.limits.q_max
    corners = np.array([counters(np.where(corner, high, low)) for corner in product([True, False], repeat=6)])
    assert corners.min() >= -32768
    assert corners.max() <= 32767
    assert (corners[:, 3] - 8000).min() < -32768


def test_a_torque_on_joint_6_takes_a_counter_torque_on_motor_5() -> None:
    """20 N·m on J6 puts 3.6 N·m on J5, which the vendor's driver ignores."""
    tau_motor = np.empty(6)
    torque_to_motor(np.array([0, 0, 0, 0, 0, 20.0]), PARAMS, tau_motor)
    np.testing.assert_allclose(tau_motor[3:], [-K46 * 20, -K56 * 20, 20])
    assert tau_motor[4] == pytest.approx(-3.6, abs=0.02)


@pytest.mark.parametrize(
    ("torque", "code"),
    [
        (0.0, 0x800),
        (1.0, 0x800 + 19),
        (-1.0, 0x800 - 19),
        (102.0, 4086),
        (103.0, 0xFFF),
        (-103.0, 0),
        (np.nan, 0x800),
        (np.inf, 0xFFF),
        (-np.inf, 0),
        (1e300, 0xFFF),
    ],
)
def test_dac_codes_of_joint_1_truncate_towards_zero_and_clamp(torque: float, code: int) -> None:
    assert dac_code(torque, 19.99) == code


def test_full_scale_torques_are_the_vendors() -> None:
    tau = np.empty(6)
    dac_to_motor_torque(np.zeros(6, dtype=np.int64), PARAMS, tau)
    np.testing.assert_allclose(np.abs(tau), [102.45, 186.7, 90.42, 24.15, 20.97, 21.56], atol=0.05)


def test_rising_dac_code_means_rising_count_on_every_axis() -> None:
    assert (np.sign(PARAMS.dac_per_Nm) == np.sign(PARAMS.rad_per_count)).all()


def test_torque_through_dac_and_drive_comes_back_within_a_step() -> None:
    wanted = np.array([30.0, -50.0, 20.0, 3.0, -2.0, 1.0])
    dac, tau_motor, tau = np.empty(6, dtype=np.int64), np.empty(6), np.empty(6)
    torque_to_dac(wanted, PARAMS, tau_motor, dac)
    dac_to_motor_torque(dac, PARAMS, tau_motor)
    motor_to_torque(tau_motor, PARAMS, tau)
    assert (np.abs(tau - wanted) <= np.array([0.051, 0.092, 0.045, 0.0125, 0.0125, 0.0106])).all()


def test_the_potentiometer_loses_150_units_for_a_turn_of_any_motor() -> None:
    """109 motor turns per 5 V, i.e. 16384 units (vendor's sample calibration table)."""
    pot, turned = np.empty(6), np.empty(6)
    motor_to_pot(np.zeros(6), PARAMS, pot)
    np.testing.assert_array_equal(pot, ROBOT.transmission.pot_at_zero)
    motor_to_pot(PARAMS.rad_per_count * PARAMS.counts_per_rev, PARAMS, turned)
    np.testing.assert_allclose(turned - pot, -150.1)
    np.testing.assert_allclose(-16384 / (turned - pot), 109, atol=0.4)


def test_pot_voltage_per_radian_is_the_published_one() -> None:
    zero, one = np.empty(6), np.empty(6)
    motor_to_pot(np.zeros(6), PARAMS, zero)
    motor_to_pot(np.ones(6), PARAMS, one)
    published = np.array([-0.456, 0.783, -0.390, 0.556, 0.525, 0.561])  # TRC counts run opposite on joint 1, 3
    np.testing.assert_allclose((one - zero) * 20 / 65536, published, atol=0.004)


def test_motor_positions_are_those_of_the_coupled_joints_and_agree_with_the_counts() -> None:
    q, r = ROBOT.poses["end"], np.empty(6)
    joint_to_motor(q, PARAMS, r)
    np.testing.assert_allclose(PARAMS.q_offset + PARAMS.joint_per_motor @ r, q)
    np.testing.assert_allclose(r / PARAMS.rad_per_count + PARAMS.count_offset, counters(q), atol=0.5)


@pytest.mark.parametrize(("word", "number"), [(0, 0), (1, 1), (0x7FFF, 32767), (0x8000, -32768), (0xFFFF, -1)])
def test_words_are_signed_numbers(word: int, number: int) -> None:
    assert signed_word(word) == number
    assert count_word(number) == word


def test_a_jump_is_held_back_and_named_and_the_other_joints_go_on() -> None:
    raw, counts = np.array([10, 65530, 100]), np.array([10, -6, 100])
    limit, ahead = np.array([50, 50, 50]), np.zeros(3, dtype=np.int64)
    assert unwrap_counts(np.array([20, 4, 900]), raw, counts, limit, ahead) == 2
    assert list(counts) == [20, 4, 100]
    assert list(raw) == [20, 4, 100]
    assert unwrap_counts(np.array([20, 4, 101]), raw, counts, limit, ahead) == -1
    assert list(counts) == [20, 4, 101]


def test_a_jump_is_judged_from_where_the_motor_is_expected() -> None:
    raw, counts, limit = np.array([0, 0, 0]), np.array([0, 0, 0]), np.array([50, 50, 50])
    ahead = np.array([100, -100, 100])
    assert unwrap_counts(np.array([150, 65536 - 150, 49]), raw, counts, limit, ahead) == 2
    assert list(counts) == [150, -150, 0]
