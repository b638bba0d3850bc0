"""Precision points of VAL: where a straight line to one ends, and the configuration that is in force behind it."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.val.interpreter import RunState
from qrobot.val.values import JointLocation
from tests.support.val_runs import interpreter, main_program

PLACES = "\n.LOCATIONS\na 450 150 0 90 90 0\nb 450 100 50 90 90 0\n.END\n"
TAUGHT = "MOVE a", "BREAK", "HERE #left", "RIGHTY", "FLIP", "MOVE a", "BREAK", "HERE #right"
"""Joints of one pose in the configuration of PARK, and in the one in which the arm is behind these steps."""


@pytest.mark.parametrize("library", ["rccl", "arcl"])
@pytest.mark.parametrize("between", [(), ("LEFTY", "NOFLIP"), ("TOOL",), ("APPRO #left, 20",), ("TOOL", "MOVES b")])
def test_a_straight_line_to_a_precision_point_of_another_configuration_is_refused(
    between: tuple[str, ...], library: str
) -> None:
    with interpreter(main_program(*TAUGHT, *between, "MOVES #left", rest=PLACES), library=library) as (run, _):
        assert run.execute("main") is RunState.FAILED
        assert f"line {len(TAUGHT) + len(between) + 2}" in run.message
        assert "the configuration cannot change in a straight line; MOVE first" in run.message
        assert run.machine.space.branch(run.machine.arm.q).letters == "ruf"


@pytest.mark.parametrize("library", ["rccl", "arcl"])
@pytest.mark.parametrize("between", [("MOVE #left", "MOVE #right"), ("TOOL", "MOVE b"), ("TOOL", "MOVES b", "BREAK")])
def test_a_straight_line_ends_at_the_joints_of_a_precision_point_of_the_same_configuration(
    between: tuple[str, ...], library: str
) -> None:
    lines = *TAUGHT, *between, "MOVES b", "MOVES #right", "BREAK", "HERE #end", "ABOVE", "MOVE b"
    with interpreter(main_program(*lines, rest=PLACES), library=library) as (run, _):
        assert run.execute("main") is RunState.COMPLETED, run.message
        end, right = (run.machine.values[name, ()] for name in ("#end", "#right"))
        assert isinstance(end, JointLocation)
        assert isinstance(right, JointLocation)
        assert np.exp(1j * end.q) == pytest.approx(np.exp(1j * right.q), abs=1e-6)
        assert run.machine.space.branch(run.machine.arm.q).letters == "ruf"
