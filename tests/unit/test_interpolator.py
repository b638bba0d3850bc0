"""The reference between setpoints: through every knot, smooth to the second derivative, stopping on the path."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from qrobot.servo.interpolator import (
    N_KNOTS,
    PEAK_SLOPE,
    line_through,
    reference,
    rest_at,
    room_duration,
    shift_extrapolated,
    shift_in,
    stop_duration,
    stop_profile,
)

Vector = NDArray[np.float64]
FRAME_S = 0.028
RATE = 1.0 / FRAME_S


def at(knots: Vector, phase: float, rate: float = RATE, slope: float = 0.0) -> tuple[Vector, Vector, Vector]:
    q, v, a = np.zeros(knots.shape[1]), np.zeros(knots.shape[1]), np.zeros(knots.shape[1])
    reference(knots, phase, rate, slope, q, v, a)
    return q, v, a


knots_of_two_joints = st.lists(st.floats(-3.0, 3.0), min_size=8, max_size=8).map(lambda x: np.array(x).reshape(4, 2))


@given(knots_of_two_joints)
def test_the_reference_starts_at_knot_one_and_ends_at_knot_two(knots: Vector) -> None:
    np.testing.assert_allclose(at(knots, 0.0)[0], knots[1], atol=1e-12)
    np.testing.assert_allclose(at(knots, 1.0)[0], knots[2], atol=1e-12)


@given(knots_of_two_joints, st.floats(-3.0, 3.0))
def test_position_velocity_and_acceleration_are_continuous_across_frames(knots: Vector, following: float) -> None:
    before = at(knots, 1.0)
    shifted = knots.copy()
    shift_in(shifted, np.full(2, following))
    after = at(shifted, 0.0)
    for left, right, scale in zip(before, after, (1.0, RATE, RATE**2), strict=True):
        np.testing.assert_allclose(left, right, atol=1e-10 * scale)


@given(knots_of_two_joints, st.floats(0.01, 0.99), st.floats(0.0, 40.0), st.floats(-500.0, 500.0))
def test_velocity_and_acceleration_are_the_derivatives_in_time(
    knots: Vector, phase: float, rate: float, slope: float
) -> None:
    h = 1e-6  # seconds
    ahead = at(knots, phase + rate * h + slope * h * h / 2, rate + slope * h)
    behind = at(knots, phase - rate * h + slope * h * h / 2, rate - slope * h)
    _, v, a = at(knots, phase, rate, slope)
    np.testing.assert_allclose(v, (ahead[0] - behind[0]) / (2 * h), atol=1e-4)
    scale = 1.0 + np.abs(knots).max() * (rate**2 + abs(slope))
    np.testing.assert_allclose(a, at_rate_of_change(knots, phase, rate, slope, h), atol=1e-4 * scale)


def at_rate_of_change(knots: Vector, phase: float, rate: float, slope: float, h: float) -> Vector:
    ahead = at(knots, phase + rate * h + slope * h * h / 2, rate + slope * h)[1]
    behind = at(knots, phase - rate * h + slope * h * h / 2, rate - slope * h)[1]
    return (ahead - behind) / (2 * h)


@pytest.mark.parametrize("power", [0, 1, 2])
def test_polynomials_up_to_the_second_degree_are_reproduced_exactly(power: int) -> None:
    times = np.arange(N_KNOTS, dtype=float).reshape(4, 1)
    for phase in (0.0, 0.3, 0.77, 1.0):
        q, _, _ = at(times**power, phase)
        assert q[0] == pytest.approx((1.0 + phase) ** power, abs=1e-12)


def test_a_reference_at_rest_stands_still() -> None:
    knots = np.zeros((4, 3))
    rest_at(knots, np.array([0.1, -0.2, 0.3]))
    for phase in (0.0, 0.4, 1.0):
        q, v, a = at(knots, phase)
        np.testing.assert_allclose(q, [0.1, -0.2, 0.3], atol=1e-15)
        np.testing.assert_allclose(v, 0.0, atol=1e-12)
        np.testing.assert_allclose(a, 0.0, atol=1e-10)


def test_a_missing_setpoint_is_replaced_at_constant_velocity() -> None:
    knots = np.array([[0.0, 0.0], [0.1, 0.3], [0.2, 0.6], [0.3, 0.9]])
    shift_extrapolated(knots)
    np.testing.assert_allclose(knots[3], [0.4, 1.2])
    np.testing.assert_allclose(knots[:3], [[0.1, 0.3], [0.2, 0.6], [0.3, 0.9]])


@given(st.floats(0.0, 1.5), st.floats(0.05, 3.0))
def test_the_stop_profile_falls_smoothly_from_full_rate_to_rest(elapsed: float, duration: float) -> None:
    left, slope = stop_profile(elapsed, duration)
    assert 0.0 <= left <= 1.0
    assert slope <= 0.0
    assert abs(slope) <= PEAK_SLOPE / duration * (1 + 1e-12)
    h = 1e-6 * duration
    difference = (stop_profile(elapsed + h, duration)[0] - stop_profile(max(elapsed - h, 0.0), duration)[0]) / (
        elapsed + h - max(elapsed - h, 0.0)
    )
    assert slope == pytest.approx(difference, abs=1e-4 / duration)


def test_the_stop_profile_is_over_at_its_duration() -> None:
    assert stop_profile(0.0, 0.5) == (1.0, 0.0)
    assert stop_profile(0.5, 0.5) == (0.0, 0.0)
    assert stop_profile(float("nan"), 0.5) == (0.0, 0.0)


def test_no_joint_decelerates_harder_than_allowed_and_the_slowest_decides() -> None:
    v, a_stop = np.array([1.0, -2.0, 0.1]), np.array([5.0, 4.0, 9.0])
    duration = stop_duration(v, a_stop, 0.01)
    assert duration == pytest.approx(PEAK_SLOPE * 2.0 / 4.0)
    peak = np.abs(v) * PEAK_SLOPE / duration
    assert np.all(peak <= a_stop * (1 + 1e-12))
    assert stop_duration(np.zeros(3), a_stop, 0.01) == 0.01


def test_a_stop_near_the_end_of_the_range_is_over_before_it() -> None:
    q, v = np.array([0.9, 0.0, -0.5]), np.array([0.5, 0.0, -2.0])
    limits = np.ones(3)
    assert room_duration(q, v, -limits, limits) == pytest.approx(2.0 * 0.1 / 0.5)
    assert room_duration(q, -v, -limits, limits) == pytest.approx(2.0 * 1.5 / 2.0)
    assert room_duration(q, 0.0 * v, -limits, limits) == np.inf


@given(st.floats(0.0, 1.0), st.floats(-1.0, 1.0), st.floats(-0.2, 0.2))
def test_a_line_passes_where_it_is_told_at_the_speed_it_is_told(phase: float, q: float, step: float) -> None:
    knots = np.zeros((4, 2))
    line_through(knots, 1, phase, q, step)
    position, velocity, acceleration = at(knots, phase)
    np.testing.assert_allclose(position, [0.0, q], atol=1e-12)
    np.testing.assert_allclose(velocity, [0.0, step * RATE], atol=1e-9)
    np.testing.assert_allclose(acceleration, 0.0, atol=1e-8)
