"""Sine and cosine against the C library's, at every kind of angle."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.realtime.jit import kernel
from qrobot.realtime.sine import cosine, sine, sine_cosine

HALF_UNIT = 2.0**-54  # of the last place just below 1
TOLERANCE = HALF_UNIT + 0.6e-16


@kernel
def both(angles: Any, out: Any) -> None:
    for i in range(angles.size):
        out[0, i], out[1, i] = sine_cosine(angles[i])


@pytest.mark.parametrize("reach", [1e-9, 1.0, 10.0, 1e3, 1e6])
def test_they_are_the_c_librarys_to_the_last_bits(reach: float) -> None:
    angles, out = np.random.default_rng(7).uniform(-reach, reach, 2000), np.zeros((2, 2000))
    both(angles, out)
    expected = np.array([[math.sin(x) for x in angles], [math.cos(x) for x in angles]])
    assert np.abs(out - expected).max() <= TOLERANCE


@given(st.integers(-1000, 1000), st.floats(-1e-6, 1e-6))
def test_near_multiples_of_a_quarter_turn_nothing_cancels(quarters: int, off: float) -> None:
    x = quarters * 0.5 * math.pi + off
    assert sine_cosine(x) == pytest.approx((math.sin(x), math.cos(x)), rel=1e-12, abs=TOLERANCE)


@given(st.floats(-1e6, 1e6))
def test_symmetry_and_pythagoras(x: float) -> None:
    s, c = sine_cosine(x)
    assert sine_cosine(-x) == (-s, c)
    assert s * s + c * c == pytest.approx(1.0, abs=1e-15)
    assert (sine(x), cosine(x)) == (s, c)


def test_small_angles_come_back_unchanged() -> None:
    assert sine_cosine(1e-300) == (1e-300, 1.0)
    assert sine_cosine(0.0) == (0.0, 1.0)


@pytest.mark.parametrize("x", [math.nan, math.inf, -math.inf])
def test_what_is_no_angle_has_no_sine(x: float) -> None:
    with np.errstate(invalid="ignore"):
        assert all(math.isnan(value) for value in sine_cosine(x))
