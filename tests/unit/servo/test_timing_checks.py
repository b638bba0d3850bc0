"""The safety gate for timing, at and around every boundary."""

from __future__ import annotations

import pytest

from qrobot.faultcodes import FaultCode as F
from qrobot.servo.checks.timing_checks import (
    SLOW_CYCLES,
    check_overrun,
    check_slowness,
    grown_row,
    own_ns,
    skipped_points,
)

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


@pytest.mark.parametrize(
    ("used_ns", "given", "expected"),
    [
        (PERIOD_NS // 10, 1, 2 * PERIOD_NS),  # it waited: the time is its own
        (PERIOD_NS // 10, 0, PERIOD_NS // 10),  # others had the processor
        (3 * PERIOD_NS // 2, 0, 3 * PERIOD_NS // 2),  # they had, and it has computed for longer than a period
        (3 * PERIOD_NS, 0, 2 * PERIOD_NS),  # what was used between two readings of two clocks is no longer than it took
    ],
)
def test_a_cycle_is_not_blamed_for_the_time_of_others(used_ns: int, given: int, expected: int) -> None:
    began = (7 * PERIOD_NS, 40)
    assert own_ns(2 * PERIOD_NS, began, (began[0] + used_ns, began[1] + given)) == expected


def test_a_loop_that_is_kept_from_running_in_every_cycle_does_not_make_a_law_slow() -> None:
    """The first long cycle of a row is judged by the wall's clock, and what follows by the thread's."""
    row = 0
    for took_ns in (2 * PERIOD_NS, own_ns(2 * PERIOD_NS, (0, 0), (PERIOD_NS // 10, 0))) * 10:
        row = grown_row(row, took_ns, PERIOD_NS)
        assert check_slowness(row) == F.NONE
