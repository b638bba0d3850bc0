"""Process control programs of VAL: how long they run, and what PCEXECUTE makes of one that runs already."""

from __future__ import annotations

from typing import Final

import pytest

from qrobot.val.interpreter import RunState
from tests.support.val_runs import EXAMPLES, interpreter, main_program, number

WITHOUT_END: Final = "06_process_control.v2", "12_touch_a_plane.v2"
COUNT: Final = """
.PROGRAM count
n = n+1
TIMER 1 = 0
WAIT TIMER(1) > 0.05
.END
.PROGRAM other
DELAY 0.5
.END
.REALS
n 0
.END
"""


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", WITHOUT_END)
def test_an_example_with_a_process_control_program_without_end_can_be_run_again(name: str) -> None:
    with interpreter((EXAMPLES / name).read_text()) as (run, _):
        for cycles in (1, 2, 1):
            assert run.execute("main", cycles=cycles) is RunState.COMPLETED, run.message


def test_a_process_control_program_ends_when_another_program_is_executed() -> None:
    with interpreter(main_program("PCEXECUTE count, -1", "DELAY 0.5", "SIGNAL 99", rest=COUNT)) as (run, _):
        assert run.execute("main") is RunState.FAILED
        counted = number(run, "n")
        assert counted > 2.0
        assert run.execute("other") is RunState.COMPLETED
        assert number(run, "n") == counted


def test_one_that_runs_already_is_left_as_it_is() -> None:
    lines = "PCEXECUTE count, 20", "DELAY 0.2", "PCEXECUTE count, -1", "DELAY 2", "PCEXECUTE count, 5", "DELAY 1"
    with interpreter(main_program(*lines, rest=COUNT)) as (run, _):
        assert run.execute("main") is RunState.COMPLETED, run.message
        assert number(run, "n") == 25.0
