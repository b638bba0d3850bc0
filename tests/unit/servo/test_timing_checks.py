"""The safety gate for timing, at and around every boundary."""

from __future__ import annotations

import pytest

from qrobot.faultcodes import FaultCode as F
from qrobot.servo.checks.timing_checks import SLOW_CYCLES, check_overrun, check_slowness, grown_row, skipped_points

PERIOD_NS = 250_000


@pytest.mark.parametrize(
    ("dt_ns", "expected"),
    [
        (0, 0),
        (PERIOD_NS // 4, 0),
        (PERIOD_NS, 0),
        (PERIOD_NS + PERIOD_NS // 2 - 1, 0),
        (PERIOD_NS + PERIOD_NS // 2, 1),
        (2 * PERIOD_NS, 1),
        (201 * PERIOD_NS, 200),
    ],
)
def test_points_of_the_grid_between_two_cycles_were_skipped(dt_ns: int, expected: int) -> None:
    assert skipped_points(dt_ns, PERIOD_NS) == expected


@pytest.mark.parametrize(
    ("in_a_row", "most", "missed", "allowed", "expected"),
    [
        (0, 3, 0, 0, F.NONE),
        (2, 3, 10, 10, F.NONE),
        (3, 3, 0, 10, F.OVERRUN),
        (0, 3, 11, 10, F.OVERRUN),
        (1, 1, 0, 10, F.OVERRUN),
        (10**9, 0, 10, 10, F.NONE),
        (10**9, 0, 11, 10, F.OVERRUN),
    ],
)
def test_cycles_may_be_late_now_and_then_but_not_in_a_row_and_not_often(
    in_a_row: int, most: int, missed: int, allowed: int, expected: F
) -> None:
    assert check_overrun(in_a_row, most, missed, allowed) == expected


def test_a_row_grows_with_each_long_cycle_and_ends_with_a_short_one() -> None:
    assert [grown_row(row, busy, 100) for row, busy in ((0, 100), (0, 101), (1, 500), (2, 100))] == [0, 1, 2, 0]


def test_several_long_cycles_in_a_row_are_the_fault_of_what_runs_in_them() -> None:
    assert check_slowness(SLOW_CYCLES - 1) == F.NONE
    assert check_slowness(SLOW_CYCLES) == F.LAW_SLOW
