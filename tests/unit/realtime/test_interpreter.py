"""A program's real-time thread has the interpreter when it is due."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator
from types import SimpleNamespace

import pytest

from qrobot.rccl.callback_timing import CallbackTiming
from qrobot.realtime import interpreter
from qrobot.realtime.interpreter import TURN_S, InterpreterShare, prepare_interpreter


class Cycle:
    """Garbage that only a search finds."""

    def __init__(self) -> None:
        self.own = self


@pytest.fixture
def share(monkeypatch) -> Iterator[InterpreterShare]:
    ticks_s = iter(range(1000))  # every look at the clock is a second later
    monkeypatch.setattr(interpreter, "time", SimpleNamespace(perf_counter=lambda: next(ticks_s)))
    turn_s = sys.getswitchinterval()
    interpreter._exempt_once.cache_clear()
    share = InterpreterShare()
    yield share
    share.end()
    gc.unfreeze()
    sys.setswitchinterval(turn_s)


def test_what_lives_before_it_begins_is_never_searched_and_what_comes_later_is(share) -> None:
    before = [Cycle() for _ in range(1000)]
    prepare_interpreter()
    share.begin()
    later = Cycle()
    searched = {id(one) for one in gc.get_objects()}
    assert not any(id(one) in searched for one in before)
    assert id(later) in searched
    prepare_interpreter()  # another arm: what lives only now may be garbage some day
    assert id(later) in {id(one) for one in gc.get_objects()}
    assert gc.isenabled()
    assert sys.getswitchinterval() == pytest.approx(min(TURN_S, sys.getswitchinterval()))


def test_a_search_longer_than_a_sample_is_named_where_the_arm_was_stopped(share) -> None:
    timing = CallbackTiming(28.0)
    assert timing.complaint() == ""
    timing.share = share
    share.begin()
    assert timing.complaint() == ""
    gc.collect()
    assert "looked for garbage among the program's objects for 1000 ms" in timing.complaint()
    share.end()
    share.end()
    before = share.longest_search_ms
    gc.collect()
    assert share.longest_search_ms == before
