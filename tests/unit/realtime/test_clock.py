"""CLOCK_MONOTONIC from compiled code agrees with Python's and sleeps to absolute deadlines."""

from __future__ import annotations

import time

import pytest

from qrobot.realtime.clock import monotonic_ns, pause, sleep_until_ns
from qrobot.realtime.jit import kernel
from tests.support.patience import PATIENCE_S

pytestmark = pytest.mark.realtime  # the clock is what they are about; no bound depends on how fast it goes


@kernel
def now_ns() -> int:
    """The compiled clock."""
    return monotonic_ns()


@kernel
def sleep_for_ns(duration_ns: int) -> tuple[int, int]:
    """Sleep to an absolute deadline; returns deadline and the time of waking."""
    deadline = monotonic_ns() + duration_ns
    sleep_until_ns(deadline)
    return deadline, monotonic_ns()


@kernel
def spin(times: int) -> int:
    """Pause so many times."""
    for _ in range(times):
        pause()
    return times


def test_the_compiled_clock_is_pythons_monotonic_clock() -> None:
    now_ns()
    before = time.monotonic_ns()
    ours = now_ns()
    assert before <= ours <= time.monotonic_ns()


def test_a_sleep_never_ends_before_its_deadline() -> None:
    for duration_ns in (0, 1_000, 300_000, 3_000_000):
        deadline, woke = sleep_for_ns(duration_ns)
        assert woke >= deadline


def test_a_deadline_that_has_passed_returns_at_once() -> None:
    sleep_for_ns(0)
    start = time.monotonic_ns()
    ago_ns = 2 * round(PATIENCE_S * 1e9)
    deadline, woke = sleep_for_ns(-ago_ns)
    assert woke - deadline >= ago_ns
    assert time.monotonic_ns() - start < ago_ns


def test_pausing_returns() -> None:
    assert spin(100) == 100
