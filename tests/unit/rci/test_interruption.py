"""Ctrl-C where samples have to stay whole, at whatever line of the guard itself it comes."""

from __future__ import annotations

import signal
from contextlib import suppress
from inspect import getfile
from typing import Any

import pytest

from qrobot.rci.interruption import WholeSamples
from tests.support.signals import ctrl_c_at

OF_THE_GUARD = getfile(WholeSamples)


@pytest.fixture(autouse=True)
def _own_handler() -> Any:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def wait_for_three_samples(guard: WholeSamples) -> None:
    with guard.waiting():
        for _ in range(3):
            with guard.one(), guard.opened():
                pass


def one_sample(guard: WholeSamples, done: list[str]) -> None:
    with guard.one():
        signal.raise_signal(signal.SIGINT)
        done.append("the sample is whole")


def interrupted_at(event: int, guard: WholeSamples) -> bool:
    """Hit Ctrl-C before the line of the guard of this number is done; whether there are so many."""
    with suppress(KeyboardInterrupt), ctrl_c_at(event, OF_THE_GUARD) as seen:
        wait_for_three_samples(guard)
    return seen[0] >= event


def test_ctrl_c_at_any_line_of_the_guard_leaves_it_whole_for_the_next_wait() -> None:
    event = 1
    while interrupted_at(event, guard := WholeSamples()):
        done: list[str] = []
        with guard.waiting():
            with pytest.raises(KeyboardInterrupt):
                one_sample(guard, done)
            assert done == ["the sample is whole"], event
            with guard.one():
                pass  # it is told once
        event += 1
    assert event > 40


def test_nor_does_one_that_was_left_between_two_others_keep_it_for_ever() -> None:
    """As a program's time that was left within an interpreter's turn, and is asked to let a sample pass there again."""
    event = 1
    while interrupted_at(event, guard := WholeSamples()):
        outer, done = WholeSamples(), list[str]()
        with outer.waiting(), guard.waiting():
            with pytest.raises(KeyboardInterrupt):
                one_sample(guard, done)
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
        assert done == ["the sample is whole"], event
        with outer.waiting(), pytest.raises(KeyboardInterrupt):
            one_sample(outer, done)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        event += 1
    assert event > 40


def test_behind_a_handler_of_the_programs_own_the_one_around_it_is_obeyed_again() -> None:
    guard, heard = WholeSamples(), list[int]()
    with guard.waiting():
        within = signal.signal(signal.SIGINT, lambda number, _frame: heard.append(number))
        with guard.waiting(), guard.one():
            signal.raise_signal(signal.SIGINT)
        assert heard == [signal.SIGINT]
        signal.signal(signal.SIGINT, within)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert heard == [signal.SIGINT]


def test_one_guard_within_another_tells_it_once_and_behind_both() -> None:
    outer, done = WholeSamples(), []

    def samples() -> None:
        inner = WholeSamples()
        with outer.one():
            with inner.waiting():
                one_sample(inner, done)
            done.append("the turn is whole")
        done.append("beyond")

    with outer.waiting(), pytest.raises(KeyboardInterrupt):
        samples()
    assert done == ["the sample is whole", "the turn is whole"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
