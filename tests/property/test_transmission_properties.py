"""Round trips and power balance of the transmission, for two quite different arms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.config import load_robot
from qrobot.model.transmission import (
    count_word,
    counts_to_joint,
    dac_code,
    joint_to_counts,
    joint_to_motor,
    motor_to_torque,
    torque_to_motor,
    transmission_params,
    unwrap_counts,
)

ROBOTS = [load_robot("puma560"), load_robot("stanford")]
robots = st.sampled_from(ROBOTS)
counts6 = st.lists(st.integers(-60_000, 60_000), min_size=6, max_size=6).map(np.array)
vectors6 = st.lists(st.floats(-100, 100), min_size=6, max_size=6).map(np.array)
shares6 = st.lists(st.floats(0, 1), min_size=6, max_size=6).map(np.array)


@given(robots, counts6)
def test_counts_survive_the_way_to_joints_and_back(robot, counts) -> None:
    params, q, back = transmission_params(robot), np.empty(6), np.empty(6, dtype=np.int64)
    counts_to_joint(counts, params, q)
    joint_to_counts(q, params, back)
    np.testing.assert_array_equal(back, counts)


@given(robots, shares6)
def test_joints_survive_the_way_to_counts_and_back_to_half_a_count_of_each_motor(robot, shares) -> None:
    params = transmission_params(robot)
    q, back, counts = np.empty(6), np.empty(6), np.empty(6, dtype=np.int64)
    q[:] = robot.limits.q_min + shares * (robot.limits.q_max - robot.limits.q_min)
    joint_to_counts(q, params, counts)
    counts_to_joint(counts, params, back)
    assert (np.abs(back - q) <= 0.5 * np.abs(params.joint_per_count).sum(axis=1) + 1e-12).all()


@given(robots, vectors6, vectors6)
def test_power_is_the_same_on_both_sides_of_the_gears(robot, tau, velocity) -> None:
    params, tau_motor, r, r_zero = transmission_params(robot), np.empty(6), np.empty(6), np.empty(6)
    torque_to_motor(tau, params, tau_motor)
    joint_to_motor(velocity, params, r)
    joint_to_motor(np.zeros(6), params, r_zero)
    assert tau_motor @ (r - r_zero) == pytest.approx(tau @ velocity, abs=1e-6)


@given(robots, vectors6)
def test_motor_and_joint_torques_are_inverse(robot, tau) -> None:
    params, tau_motor, back = transmission_params(robot), np.empty(6), np.empty(6)
    torque_to_motor(tau, params, tau_motor)
    motor_to_torque(tau_motor, params, back)
    np.testing.assert_allclose(back, tau, atol=1e-9)


@given(st.integers(-(10**9), 10**9), st.lists(st.integers(-32767, 32767), max_size=40))
def test_a_counter_is_followed_through_any_number_of_wraps(start, steps) -> None:
    raw, counts = np.array([count_word(start)]), np.array([start])
    position = start
    for step in steps:
        position += step
        words, ahead = np.array([count_word(position)]), np.zeros(1, dtype=np.int64)
        assert unwrap_counts(words, raw, counts, np.array([32767]), ahead) == -1
        assert counts[0] == position


@given(st.floats(allow_nan=True, allow_infinity=True), st.sampled_from([19.99, -10.97, 22.65, -84.80, -97.68, -95.0]))
def test_every_torque_gives_a_code_of_twelve_bits_on_its_own_side_of_zero(torque, scale) -> None:
    code = dac_code(torque, scale)
    assert 0 <= code <= 0xFFF
    if not np.isnan(torque):
        assert (code - 0x800) * torque * scale >= 0
