"""Conversions are what the definitions of the units say."""

import math

from qrobot import units


def test_half_a_turn_is_180_degrees_and_pi() -> None:
    assert math.isclose(units.RAD_PER_DEG * 180, math.pi)
    assert math.isclose(units.RAD_PER_DEG * units.DEG_PER_RAD, 1.0)


def test_a_second_has_the_parts_it_should() -> None:
    assert units.NS_PER_S == 1000 * units.NS_PER_MS == 1_000_000 * units.NS_PER_US
    assert units.MS_PER_S * units.S_PER_MS == 1.0
    assert units.M_PER_MM * units.MM_PER_M == 1.0
