"""Motions of VAL that count from where the arm is, on an arm that hangs a little below where it was told to be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from qrobot.val.interpreter import Interpreter, RunState
from qrobot.val.source import read_source
from qrobot.wire import RobotState
from tests.support.fake_robot import FakeRobot
from tests.support.puma import PARK
from tests.support.val_runs import faked_arm, main_program

PLACES = "\n.LOCATIONS\na 450 150 0 90 90 0\n.END\n"
SAG = np.array([0.0, -0.01, 0.0, 0.0, 0.0, 0.0])  # rad


class SaggingRobot(FakeRobot):
    """A robot whose servo has an error of `SAG`."""

    def _state(self) -> RobotState:
        return replace(super()._state(), q=tuple(np.array(self.q) + SAG))


@pytest.mark.parametrize("library", ["rccl", "arcl"])
def test_drive_moves_one_joint_and_by_as_much_as_it_says(library: str) -> None:
    fake = SaggingRobot(tuple(PARK))
    with faked_arm(fake, library) as arm:
        run = Interpreter(arm)
        run.machine.load(
            read_source(main_program("MOVE a", "BREAK", "DRIVE 1, 5, 20", "DRIVE 1, 5, 20", rest=PLACES))[0]
        )
        assert run.do("MOVE a") is RunState.COMPLETED
        there = np.array(fake.q)
        assert run.execute("main") is RunState.COMPLETED, run.message
        assert np.array(fake.q) - there == pytest.approx([np.radians(10.0), 0.0, 0.0, 0.0, 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize("library", ["rccl", "arcl"])
def test_behind_tool_the_arm_counts_as_where_it_was_told_to_be(library: str) -> None:
    with faked_arm(SaggingRobot(tuple(PARK)), library) as arm:
        run = Interpreter(arm)
        run.machine.load(read_source(main_program("MOVE a", "TOOL", "x = DISTANCE(DEST, a)", rest=PLACES))[0])
        assert run.execute("main") is RunState.COMPLETED, run.message
        assert run.machine.values["x", ()] == pytest.approx(0.0, abs=1e-6)
        assert run.machine.frame("here")[:3, 3] != pytest.approx(run.machine.frame("dest")[:3, 3], abs=1e-3)
