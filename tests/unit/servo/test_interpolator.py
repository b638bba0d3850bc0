"""The reference between setpoints, in every form: as smooth and as exact as the form says, stopping on the path."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from qrobot.servo.kernels.interpolation_polynomials import FORMS, N_KNOTS, Form
from qrobot.servo.kernels.interpolator import (
    PEAK_SLOPE,
    line_through,
    reference,
    rest_at,
    room_duration,
    shift_extrapolated,
    shift_in,
    stop_duration,
    stop_profile,
    stop_way,
)

Vector = NDArray[np.float64]
FRAME_S = 0.028
RATE = 1.0 / FRAME_S


def at(
    form: Form, knots: Vector, phase: float, rate: float = RATE, slope: float = 0.0, rounding: Vector | None = None
) -> tuple[Vector, Vector, Vector]:
    n = knots.shape[1]
    q, v, a = np.zeros(n), np.zeros(n), np.zeros(n)
    reference(form.table, knots, np.zeros((2, n)) if rounding is None else rounding, phase, rate, slope, q, v, a)
    return q, v, a


knots_of_two_joints = st.lists(st.floats(-3.0, 3.0), min_size=8, max_size=8).map(lambda x: np.array(x).reshape(4, 2))
every_form = pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)


@pytest.mark.parametrize("name", ["linear", "cubic", "quintic"])
@given(knots_of_two_joints)
def test_the_reference_goes_from_its_first_knot_to_the_next(name: str, knots: Vector) -> None:
    form = FORMS[name]
    np.testing.assert_allclose(at(form, knots, 0.0)[0], knots[form.first_knot], atol=1e-12)
    np.testing.assert_allclose(at(form, knots, 1.0)[0], knots[form.first_knot + 1], atol=1e-12)


@given(knots_of_two_joints, st.floats(0.0, 1.0))
def test_the_b_spline_stays_among_its_knots(knots: Vector, phase: float) -> None:
    q, _, _ = at(FORMS["b-spline"], knots, phase)
    assert np.all(q >= knots.min(axis=0) - 1e-12)
    assert np.all(q <= knots.max(axis=0) + 1e-12)


@every_form
@given(knots_of_two_joints, st.floats(-3.0, 3.0))
def test_across_frames_the_reference_is_continuous_to_the_order_the_form_says(
    form: Form, knots: Vector, following: float
) -> None:
    before = at(form, knots, 1.0)
    shifted = knots.copy()
    shift_in(shifted, np.full(2, following))
    after = at(form, shifted, 0.0)
    for order in range(form.continuity + 1):
        np.testing.assert_allclose(before[order], after[order], atol=1e-10 * RATE**order)


@every_form
def test_the_next_derivative_does_jump_for_some_setpoints(form: Form) -> None:
    knots = np.array([[0.0], [1.0], [0.0], [2.0]])
    derivative = [at(form, knots, 1.0), at(form, knots, 0.0)]
    shift_in(knots, np.array([-1.0]))
    derivative[1] = at(form, knots, 0.0)
    if form.continuity < 2:
        assert abs(derivative[0][form.continuity + 1] - derivative[1][form.continuity + 1]) > 1.0
    else:  # the third derivative, by differences
        h = 1e-5
        knots_before = np.array([[0.0], [1.0], [0.0], [2.0]])
        jerk_before = (at(form, knots_before, 1.0)[2] - at(form, knots_before, 1.0 - h)[2]) / h
        jerk_after = (at(form, knots, h)[2] - at(form, knots, 0.0)[2]) / h
        assert abs(jerk_before - jerk_after) > 1.0


@every_form
@given(knots_of_two_joints, st.floats(0.01, 0.99), st.floats(0.0, 40.0), st.floats(-500.0, 500.0))
def test_velocity_and_acceleration_are_the_derivatives_in_time(
    form: Form, knots: Vector, phase: float, rate: float, slope: float
) -> None:
    h = 1e-6  # seconds
    ahead = at(form, knots, phase + rate * h + slope * h * h / 2, rate + slope * h)
    behind = at(form, knots, phase - rate * h + slope * h * h / 2, rate - slope * h)
    _, v, a = at(form, knots, phase, rate, slope)
    np.testing.assert_allclose(v, (ahead[0] - behind[0]) / (2 * h), atol=1e-4)
    scale = 1.0 + np.abs(knots).max() * (rate**2 + abs(slope))
    np.testing.assert_allclose(a, (ahead[1] - behind[1]) / (2 * h), atol=1e-4 * scale)


@every_form
@given(st.lists(st.floats(-2.0, 2.0), min_size=6, max_size=6), st.floats(0.0, 1.0))
def test_motions_up_to_the_degree_the_form_says_come_out_exactly(
    form: Form, coefficients: list[float], phase: float
) -> None:
    motion = np.polynomial.Polynomial(coefficients[: form.degree + 1])
    knots = motion(np.arange(N_KNOTS, dtype=float)).reshape(4, 1)
    for order, value in enumerate(at(form, knots, phase, rate=1.0)):
        wanted = motion.deriv(order)(form.first_knot + phase) if order else motion(form.first_knot + phase)
        assert value[0] == pytest.approx(wanted, abs=1e-9)


@every_form
def test_one_degree_more_does_not_come_out_exactly(form: Form) -> None:
    knots = np.arange(N_KNOTS, dtype=float).reshape(4, 1) ** (form.degree + 1)
    errors = [at(form, knots, u)[0][0] - (form.first_knot + u) ** (form.degree + 1) for u in (0.0, 0.3, 0.77)]
    assert np.abs(errors).max() > 0.01


@pytest.mark.parametrize("name", ["cubic", "quintic"])
@given(knots_of_two_joints, st.floats(-3.0, 3.0))
def test_a_reference_passes_beside_its_knots_as_far_as_it_is_told_and_as_smoothly_as_its_form(
    name: str, knots: Vector, following: float
) -> None:
    form, rounding = FORMS[name], np.array([[0.1, -0.2], [0.3, 0.0]])
    before = at(form, knots, 1.0, rounding=rounding)
    np.testing.assert_allclose(at(form, knots, 0.0, rounding=rounding)[0], knots[1] + rounding[0], atol=1e-12)
    np.testing.assert_allclose(before[0], knots[2] + rounding[1], atol=1e-12)
    shift_in(knots, np.full(2, following))
    after = at(form, knots, 0.0, rounding=np.array([rounding[1], [0.4, -0.5]]))
    for order in range(form.continuity + 1):
        np.testing.assert_allclose(before[order], after[order], atol=1e-10 * RATE**order)


@given(knots_of_two_joints, st.floats(0.0, 1.0))
def test_beside_its_knots_by_a_sixth_of_the_bend_the_quintic_and_the_cubic_are_the_b_spline(
    knots: Vector, phase: float
) -> None:
    bends = np.diff(knots, 2, axis=0)
    wanted = at(FORMS["b-spline"], knots, phase)
    for name in ("quintic", "cubic"):
        for value, right in zip(at(FORMS[name], knots, phase, rounding=bends / 6.0), wanted, strict=True):
            np.testing.assert_allclose(value, right, atol=1e-9 * RATE**2)


@every_form
def test_a_reference_at_rest_stands_still_to_the_last_bit(form: Form) -> None:
    knots, q_rest = np.zeros((4, 3)), np.array([0.1, -0.2, 0.3])
    rest_at(knots, np.ones((2, 3)), q_rest)
    for phase in (0.0, 0.4, 1.0):
        q, v, a = at(form, knots, phase)
        assert np.array_equal(q, q_rest)
        assert not v.any()
        assert not a.any()


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


@given(st.floats(0.05, 3.0), st.lists(st.floats(1e-4, 0.7), min_size=1, max_size=40))
def test_a_stop_goes_as_far_whatever_cycles_it_is_cut_into(duration: float, cycles: list[float]) -> None:
    """The first one may have begun before the stop did, and the last one may end after it."""
    elapsed, way, before = 0.0, 0.0, min(0.5, cycles[0]) * cycles[0]
    for k, dt in enumerate(cycles):
        elapsed += dt - (before if k == 0 else 0.0)
        way += stop_way(elapsed, dt, duration)
    points, weights = np.polynomial.legendre.leggauss(4)  # exact for the quintic
    half = 0.5 * min(elapsed, duration)
    expected = before + half * sum(
        w * stop_profile(half * (1.0 + x), duration)[0] for x, w in zip(points, weights, strict=True)
    )
    assert way == pytest.approx(expected, abs=1e-9)


def test_no_joint_decelerates_harder_than_allowed_and_the_slowest_decides() -> None:
    v, a_stop = np.array([1.0, -2.0, 0.1]), np.array([5.0, 4.0, 9.0])
    duration = stop_duration(v, a_stop, 0.01)
    assert duration == pytest.approx(PEAK_SLOPE * 2.0 / 4.0)
    peak = np.abs(v) * PEAK_SLOPE / duration
    assert np.all(peak <= a_stop * (1 + 1e-12))
    assert stop_duration(np.zeros(3), a_stop, 0.01) == 0.01


def test_a_stop_near_the_end_of_the_range_is_over_before_it() -> None:
    q, v = np.array([0.9, 0.0, -0.5]), np.array([0.5, 0.0, -2.0])
    limits, none = np.ones(3), np.zeros(3)
    assert room_duration(q, v, -limits, limits, none, none) == pytest.approx(2.0 * 0.1 / 0.5)
    assert room_duration(q, -v, -limits, limits, none, none) == pytest.approx(2.0 * 1.5 / 2.0)
    assert room_duration(q, 0.0 * v, -limits, limits, none, none) == np.inf


def test_a_stop_keeps_free_what_the_arm_outruns_its_reference_by_but_for_half_the_margin() -> None:
    q, v, limits = np.array([0.9]), np.array([0.5]), np.ones(1)
    overshoot_s, margin = np.array([0.04]), np.array([0.01])
    assert room_duration(q, v, -limits, limits, overshoot_s, margin) == pytest.approx(2.0 * (0.1 - 0.015) / 0.5)
    assert room_duration(q, 0.1 * v, -limits, limits, overshoot_s, margin) == pytest.approx(2.0 * 0.1 / 0.05)
    assert room_duration(q, v, -limits, limits, 10.0 * overshoot_s, margin) == pytest.approx(2.0 * 0.05 / 0.5)


@every_form
@given(st.floats(0.0, 1.0), st.floats(-1.0, 1.0), st.floats(-0.2, 0.2))
def test_a_line_passes_where_it_is_told_at_the_speed_it_is_told(
    form: Form, phase: float, q: float, step: float
) -> None:
    knots, rounding = np.zeros((4, 2)), np.array([[0.0, 0.1], [0.0, 0.2]])
    line_through(knots, rounding, form.first_knot, 1, phase, q, step)
    position, velocity, acceleration = at(form, knots, phase, rounding=rounding)
    np.testing.assert_allclose(position, [0.0, q], atol=1e-12)
    np.testing.assert_allclose(velocity, [0.0, step * RATE], atol=1e-9)
    np.testing.assert_allclose(acceleration, 0.0, atol=1e-8)
