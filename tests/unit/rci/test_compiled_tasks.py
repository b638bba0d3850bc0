"""Tasks of compiled functions on virtual time: the same ticks in the same order as any other."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot import rci
from qrobot.errors import ConfigError
from qrobot.rci.compiled import tick_at_time, time_of_tick
from qrobot.units import NS_PER_S
from tests.support import rci_compiled as functions
from tests.support.rci_tasks import pass_ticks, recorded, virtual_program
from tests.support.thorough import examples


def test_a_compiled_task_runs_at_its_ticks_on_the_memory_of_its_name() -> None:
    with virtual_program() as runs:
        plain, td = recorded(runs, "plain", 3, 1), rci.rci_create("filter", "compiled")
        memory = rci.rci_shared_memory("filter", 8 * (functions.N_TICKS + 2)).view(np.float64)
        rci.rci_control(td, functions.note, functions.double)
        rci.rci_onclock(td, 5, 2)
        rci.rci_start(td.bit | plain.bit)
        pass_ticks(41)
        rci.rci_release(td.bit)
        pass_ticks(10)
        assert td.runs == 8
    assert np.flatnonzero(memory[1:-1]).tolist() == list(range(2, 41, 5))
    assert (memory[0], memory[-1]) == (8.0, 16.0)
    assert [tick for tick, _ in runs][:3] == [1, 4, 7]


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda td: rci.rci_control(td, lambda _td: None), "functions that Numba has compiled"),
        (lambda td: rci.rci_control(td, functions.of_three), "takes a tick and an array of numbers"),
        (lambda td: rci.rci_control(td, functions.square), "scipy .* is required for linear algebra"),
        (lambda td: rci.rci_onfunction(td, lambda: True), "woken by the clock alone"),
        (lambda td: rci.rci_trigger(td, 1, 0, lambda _td: None), "woken by the clock alone"),
        (lambda _: rci.rci_create("second", "compiled"), "runs one task"),
        (lambda _: rci.rci_create("puma560", "compiled1"), "none with a robot"),
    ],
)
def test_what_compiled_tasks_cannot_do_is_refused(call, text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "scipy", None)  # as where it is not installed
    with virtual_program():
        td = rci.rci_create("filter", "compiled")
        with pytest.raises(ConfigError, match=text):
            call(td)


YEAR_NS = 366 * 86_400 * NS_PER_S


@settings(max_examples=examples(200))
@given(st.integers(-YEAR_NS, 100 * YEAR_NS), st.integers(1, 1000))
def test_ticks_of_a_compiled_loop_are_those_of_whole_numbers_without_end(since_ns: int, rate_hz: int) -> None:
    tick = since_ns * rate_hz // NS_PER_S
    assert tick_at_time(since_ns, rate_hz) == tick
    assert time_of_tick(tick, rate_hz) == -(-tick * NS_PER_S // rate_hz)
