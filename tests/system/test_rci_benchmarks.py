"""The benchmarks of RCI at a tiny size: they run, count every wake-up, and judge nothing by the clock."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.c_programs import made
from benchmarks.rci import beside, case, measured_compiled, measured_in_c, measured_in_python
from benchmarks.rci_answers import answers
from benchmarks.rci_pairs import latencies
from benchmarks.wakeup import IDLE
from tests.support.c_programs import needs_compiler

pytestmark = pytest.mark.realtime
CLOSE_US = 10.0  # to which the instant of a tick is found, twice


@pytest.mark.parametrize("measured", [measured_in_python, measured_compiled])
def test_each_wake_up_of_two_tasks_is_measured_and_none_is_early(measured) -> None:
    late, missed = measured(1000, 2, 10)
    assert late.size >= 15
    assert late.min() > -CLOSE_US
    assert missed >= 0


@needs_compiler
def test_tasks_in_c_stand_beside_their_bare_loop(tmp_path: Path, own_cache: Path) -> None:
    program = made("rci_wakeup", tmp_path)
    (late, missed), (peer, _) = (measured_in_c(program, what, 1000, 1, 10) for what in ("tasks", "twin"))
    rows = list(beside(case(1000, IDLE, "C"), late, peer, missed))
    assert [row.labels["figure"] for row in rows] == ["p50", "p99", "missed"]
    assert rows[0].ratio == pytest.approx(np.quantile(late, 0.5) / np.quantile(peer, 0.5))


@needs_compiler
def test_a_task_in_c_with_a_robot_answers_each_state(tmp_path: Path, own_cache: Path) -> None:
    late, missed = answers(made("rci_wakeup", tmp_path), 20)
    assert late.shape == (20,)
    assert (late > 0.0).all()
    assert missed >= 0


@pytest.mark.thorough
def test_messages_between_processors_that_are_processes_are_timed() -> None:
    late = latencies("messages", 5)
    assert late.shape == (5,)
    assert (late > 0.0).all()
