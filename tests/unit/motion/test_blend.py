"""The transition polynomials against Paul's formulas and the worked number of mathematics that follows from them."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.motion.path.blend import PEAK, Blend, Correction, absorb, beta, fade
from qrobot.motion.path.path_piece import BlendSettings, piece_from_state, piece_joining_line

A, B, C, T1, TA = 8.0, 10.0, 40.0, 1.0, 0.1
TICK = 0.01
BLENDS = list(Blend)
FUNCTIONS = [
    lambda h: beta(Blend.QUARTIC, h),
    lambda h: beta(Blend.ZERO_JERK, h),
    absorb,
    lambda h: fade(Correction.CUBIC, h),
    lambda h: fade(Correction.SMOOTH, h),
]


def paul_1981(h: float) -> tuple[float, float, float]:
    """Position, velocity and acceleration as Paul (1981) writes them."""
    b, c = A - B, C - B
    k = c * TA / T1 + b
    return (
        (k * (2 - h) * h * h - 2 * b) * h + B + b,
        (k * (1.5 - h) * 2 * h * h - b) / TA,
        k * (1 - h) * 3 * h / TA**2,
    )


def worked_example(h: float) -> tuple[float, ...]:
    """The same transition as a leg: D = 2 Ta, in samples of 10 ms."""
    start = np.array([[A], [(B - A) / TA], [0.0]])
    piece = piece_from_state(start, np.array([(C - B) / T1]), 0.0, 2 * TA / TICK)
    return tuple(piece.state(h * 2 * TA / TICK, BlendSettings(TICK))[:, 0])


@pytest.mark.parametrize(("h", "q"), [(0, 8.0), (0.25, 9.02734375), (0.5, 10.1875), (0.75, 11.52734375), (1, 13.0)])
def test_pauls_worked_number(h, q) -> None:
    assert worked_example(h)[0] == pytest.approx(q, abs=1e-12)


@pytest.mark.parametrize("h", np.linspace(0.0, 1.0, 17))
def test_the_velocity_form_is_pauls_quartic(h) -> None:
    assert worked_example(h) == pytest.approx(paul_1981(h), abs=1e-9)


def test_behind_the_transition_the_path_is_the_straight_line_that_leaves_the_corner() -> None:
    t = 0.7  # after the corner, T1 = 1
    q, v, a = worked_example((t + TA) / (2 * TA))
    assert (q, v, a) == pytest.approx((B + (C - B) * t / T1, (C - B) / T1, 0.0))


def test_the_corner_is_missed_by_three_sixteenths_of_the_change() -> None:
    k = (C - B) * TA / T1 + (A - B)
    assert worked_example(0.5)[0] - B == pytest.approx(3 / 16 * k)


@pytest.mark.parametrize("blend", BLENDS)
def test_a_blend_joins_two_velocities_without_a_jump(blend) -> None:
    assert beta(blend, 0.0) == (0.0, 0.0, 0.0)
    assert beta(blend, 1.0 - 1e-9) == pytest.approx((0.5, 1.0, 0.0), abs=1e-7)
    assert beta(blend, 1.0) == (0.5, 1.0, 0.0)
    assert beta(blend, 2.5) == (2.0, 1.0, 0.0)


@pytest.mark.parametrize("h", [0.0, 1.0])
def test_the_zero_jerk_blend_has_no_jerk_at_its_ends(h) -> None:
    step = 1e-6
    inside = abs(h - step)
    assert abs(beta(Blend.ZERO_JERK, inside)[2]) / step < 1e-4
    assert abs(beta(Blend.QUARTIC, inside)[2]) / step == pytest.approx(6.0, rel=1e-4)


@pytest.mark.parametrize("blend", BLENDS)
def test_velocities_stay_between_the_two_they_join_and_peak_is_the_largest_acceleration(blend) -> None:
    slopes, bends = zip(*(beta(blend, h)[1:] for h in np.linspace(0, 1, 1001)), strict=True)
    assert np.diff(slopes).min() >= 0.0
    assert max(bends) == pytest.approx(PEAK[blend], abs=1e-5)


@pytest.mark.parametrize("function", FUNCTIONS)
@pytest.mark.parametrize("h", [0.1, 0.35, 0.5, 0.8])
def test_the_derivatives_are_the_derivatives(function, h) -> None:
    step = 1e-5
    value, slope, bend = zip(function(h - step), function(h), function(h + step), strict=True)
    assert (value[2] - value[0]) / (2 * step) == pytest.approx(slope[1], abs=1e-8)
    assert (slope[2] - slope[0]) / (2 * step) == pytest.approx(bend[1], abs=1e-8)


def test_a_left_over_acceleration_fades_out_and_changes_nothing_else() -> None:
    assert absorb(0.0) == (0.0, 0.0, 1.0)
    assert absorb(1.0 - 1e-12) == pytest.approx((0.0, 0.0, 0.0), abs=1e-11)
    assert absorb(3.0) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("correction", list(Correction))
def test_an_unexpected_velocity_fades_out_and_changes_nothing_else(correction) -> None:
    assert fade(correction, 0.0)[:2] == (0.0, 1.0)
    assert fade(correction, 1.0 - 1e-12)[:2] == pytest.approx((0.0, 0.0), abs=1e-11)
    assert fade(correction, 3.0) == (0.0, 0.0, 0.0)


def test_the_correction_of_the_papers_is_a_cubic_whose_acceleration_jumps_and_ours_does_not_jump() -> None:
    """c = h (1 - h)^2: c''(0) = -4, c''(1) = 2, largest value 4/27 at a third (Hayward & Paul 1986, section 2.3)."""
    assert fade(Correction.CUBIC, 1 / 3)[0] == pytest.approx(4 / 27)
    assert [fade(Correction.CUBIC, h)[2] for h in (0.0, 1.0 - 1e-12)] == pytest.approx([-4.0, 2.0])
    assert [fade(Correction.SMOOTH, h)[2] for h in (0.0, 1.0 - 1e-12)] == pytest.approx([0.0, 0.0], abs=1e-10)


def test_a_transition_that_starts_too_fast_still_ends_on_the_line_that_leaves_the_corner() -> None:
    start = np.array([[A], [35.0], [-60.0]])
    v1 = np.array([(C - B) / T1])
    piece = piece_joining_line(start, np.array([B]), TA / TICK, v1, 0.0, 2 * TA / TICK, TICK)
    assert piece.state(0.0, BlendSettings(TICK)) == pytest.approx(start)
    assert piece.state(piece.end, BlendSettings(TICK))[:, 0] == pytest.approx([B + v1[0] * TA, v1[0], 0.0])
