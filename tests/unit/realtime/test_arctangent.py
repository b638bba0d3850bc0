"""The angle of a vector against the C library's, at every kind of vector."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.realtime.arctangent import angle_of
from qrobot.realtime.jit import kernel

UNITS = 3.0  # of the last place: 2 of ours, 1 of the C library's
lengths = st.floats(1e-300, 1e300)


@kernel
def angles(y: Any, x: Any, out: Any) -> None:
    for i in range(y.size):
        out[i] = angle_of(y[i], x[i])


def distance(found: float, expected: float) -> float:
    """In units of the last place."""
    return abs(found - expected) / float(np.spacing(max(abs(expected), 1e-300)))


@pytest.mark.parametrize("narrow", [1.0, 1e-3, 1e-9])
def test_it_is_the_c_librarys_to_the_last_bits(narrow: float) -> None:
    y, x = np.random.default_rng(3).normal(size=(2, 3000))
    out = np.empty(3000)
    for tall, wide in ((y, narrow * x), (narrow * y, x)):
        angles(tall, wide, out)
        expected = [math.atan2(*pair) for pair in zip(tall, wide, strict=True)]
        assert max(map(distance, out, expected)) <= UNITS


@given(st.integers(-4, 4), lengths, st.floats(-1e-9, 1e-9))
def test_near_multiples_of_an_eighth_of_a_turn_nothing_cancels(eighths: int, length: float, off: float) -> None:
    angle = eighths * 0.25 * math.pi + off
    y, x = length * math.sin(angle), length * math.cos(angle)
    assert distance(angle_of(y, x), math.atan2(y, x)) <= UNITS


@given(lengths, lengths)
def test_mirrored_vectors_have_mirrored_angles(y: float, x: float) -> None:
    angle = angle_of(y, x)
    assert angle_of(-y, x) == -angle
    assert angle_of(y, -x) == pytest.approx(math.pi - angle, rel=1e-15)
    assert angle_of(x, y) == pytest.approx(0.5 * math.pi - angle, rel=1e-15, abs=1e-16)


@pytest.mark.parametrize(
    ("y", "x", "expected"),
    [
        (0.0, 1.0, 0.0),
        (1.0, 0.0, 0.5 * math.pi),
        (-1.0, 0.0, -0.5 * math.pi),
        (0.0, -1.0, math.pi),
        (-0.0, -1.0, -math.pi),
        (1.0, 1.0, 0.25 * math.pi),
        (0.0, 0.0, 0.0),
    ],
)
def test_along_the_axes_it_is_exact(y: float, x: float, expected: float) -> None:
    assert angle_of(y, x) == expected


def test_what_is_no_number_has_no_angle() -> None:
    assert math.isnan(angle_of(math.nan, 1.0))
    assert math.isnan(angle_of(1.0, math.nan))
