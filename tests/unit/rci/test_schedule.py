"""The scheduler against the paper's own words: `if ((clock_ticks - offset) % interval == 0) wakeup the task`."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.errors import ConfigError
from qrobot.rci.schedule import TaskScheduler, check_interval

ENTRIES = st.lists(st.tuples(st.integers(1, 40), st.integers(-100, 100)), min_size=1, max_size=5)
STEPS = st.lists(st.integers(0, 60), min_size=1, max_size=30)


def woken(entries: list[tuple[int, int]], tick: int) -> list[int]:
    """The oracle: the paper's rule, at one tick."""
    return [key for key, (interval, offset) in enumerate(entries) if (tick - offset) % interval == 0]


def scheduled(entries: list[tuple[int, int]]) -> TaskScheduler:
    scheduler = TaskScheduler()
    for key, (interval, offset) in enumerate(entries):
        scheduler.set(key, interval, offset)
        scheduler.activate(key)
    return scheduler


@given(ENTRIES)
def test_a_task_is_woken_at_exactly_the_ticks_of_the_papers_rule(entries: list[tuple[int, int]]) -> None:
    scheduler = scheduled(entries)
    for tick in range(150):
        assert scheduler.due(tick) == [(key, 1) for key in woken(entries, tick)]


@given(ENTRIES, STEPS)
def test_a_scheduler_that_comes_late_counts_every_tick_that_has_passed(entries, steps: list[int]) -> None:
    scheduler, tick = scheduled(entries), -1
    for step in steps:
        passed = [key for t in range(tick + 1, tick + step + 1) for key in woken(entries, t)]
        tick += step
        assert dict(scheduler.due(tick)) == {key: passed.count(key) for key in set(passed)}


@given(ENTRIES)
def test_between_two_ticks_that_are_asked_for_nothing_is_due(entries: list[tuple[int, int]]) -> None:
    scheduler, visited = scheduled(entries), []
    while (tick := scheduler.next_tick) is not None and tick < 150:
        assert scheduler.due(tick)
        visited.append(tick)
    assert visited == [tick for tick in range(150) if woken(entries, tick)]


@given(ENTRIES, st.integers(0, 50), st.integers(0, 50))
def test_what_is_activated_at_a_tick_begins_behind_it_and_stops_when_it_is_taken_out(entries, first, last) -> None:
    scheduler = TaskScheduler()
    for key, entry in enumerate(entries):
        scheduler.set(key, *entry)
    assert [scheduler.due(tick) for tick in range(first + 1)] == [[]] * (first + 1)
    for key in range(len(entries)):
        scheduler.activate(key)
    for tick in range(first + 1, first + last):
        assert [key for key, _ in scheduler.due(tick)] == woken(entries, tick)
    for key in range(len(entries)):
        scheduler.deactivate(key)
    assert scheduler.next_tick is None
    assert scheduler.due(first + last + 200) == []


def test_several_are_activated_at_one_tick_of_the_future_together() -> None:
    scheduler = scheduled([(1, 0), (1, 0)])
    scheduler.due(10)
    for key in (0, 1):
        scheduler.deactivate(key)
        scheduler.activate(key, after=14)
    assert [tick for tick in range(11, 18) if scheduler.due(tick)] == [15, 16, 17]


def test_an_interval_that_changes_counts_from_the_next_tick_on() -> None:
    scheduler = scheduled([(4, 0)])
    assert [tick for tick in range(6) if scheduler.due(tick)] == [0, 4]
    scheduler.set(0, 3, 1)
    assert [tick for tick in range(6, 15) if scheduler.due(tick)] == [7, 10, 13]
    scheduler.remove(0)
    assert scheduler.next_tick is None


@pytest.mark.parametrize(("interval", "offset"), [(0, 0), (-4, 0), (2.5, 0), (True, 0), ("4", 0), (4, 0.5), (4, None)])
def test_what_is_no_number_of_ticks_is_refused(interval: object, offset: object) -> None:
    with pytest.raises(ConfigError, match="a whole number of clock ticks"):
        check_interval("filter", interval, offset)
