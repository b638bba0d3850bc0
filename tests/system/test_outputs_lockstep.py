"""Outputs of a program, from `chg` to the lamps of the emulated panel, with a cell that answers through an input."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from qrobot import rccl
from qrobot.errors import MotionError
from qrobot.hwif.registers import DISCRETE_LINES
from qrobot.rccl.c.program import run_executable
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.output_lines import OutputWire
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.c_programs import compiled_text, needs_compiler
from tests.support.puma import ROBOT

SAMPLE_US = 28_000
C_PROGRAM = """
both() { return how.outputs == 3; }
grip() { return how.outputs == 1; }
main()
{
    int on;

    move(park);
    chg.outputs |= 3;
    waitas(both());
    on = how.outputs;
    chg.outputs &= ~2;
    waitas(grip());
    printf("on %d, then %d\\n", on, how.outputs);
    return 0;
}
"""
GRIP, GRIP_BIT, GLUE, GRIPPED = 0b01, 0x10, 0b10, 1 << 2
WIRES = (OutputWire(1, "grip", holds=True, bit=4), OutputWire(2, "glue"))


@pytest.fixture
def rig() -> Iterator[LockstepRig]:
    rig = LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0, outputs=WIRES), Emulator(ROBOT, physics="rigid"))
    with rccl.use(partial(link_factory, rig, SAMPLE_US)):
        yield rig


def cell(rig: LockstepRig) -> None:
    """What the outputs do to the world: a gripper that has closed says so."""
    rig.board.panel.inputs = GRIPPED if rig.board.panel.discrete & GRIP_BIT else 0


def test_a_program_switches_an_output_and_sees_the_input_it_works(rig: LockstepRig) -> None:
    with rccl.control() as arm:
        arm.each_sample(partial(cell, rig))
        asked_ms = arm.time
        arm.signal(1, 2)
        arm.waitas(lambda: arm.how.inputs & GRIPPED)
        assert arm.time - asked_ms <= 3 * SAMPLE_US * 1e-3
        assert arm.how.outputs == rig.board.panel.outputs == GRIP | GLUE
        arm.signal(-1)
        arm.waitas(lambda: not arm.how.inputs & GRIPPED)
        assert arm.how.outputs == GLUE
        with pytest.raises(MotionError, match="outputs are 1 to 16"):
            arm.signal(17)


def test_what_holds_outlasts_its_program_and_is_the_next_one_s(rig: LockstepRig) -> None:
    with rccl.control() as arm:
        arm.signal(1, 2)
        arm.waitas(lambda: arm.how.outputs == GRIP | GLUE)
    assert rig.board.panel.outputs == GRIP
    rig.run_for(1.0)
    assert rig.board.panel.outputs == GRIP
    with rccl.control() as arm:
        arm.move(arm.pose("park"))
        arm.waitfor(arm.completed)
        assert arm.how.outputs == GRIP
        assert rig.board.panel.discrete & DISCRETE_LINES == GRIP_BIT
        arm.signal(2, -1)
        arm.waitas(lambda: arm.how.outputs == GLUE)


@needs_compiler
def test_a_c_program_switches_outputs_anywhere_and_sees_which_are_on(rig: LockstepRig, tmp_path: Path, capfd) -> None:
    program = compiled_text(C_PROGRAM, tmp_path)
    assert run_executable(program) == 0
    assert capfd.readouterr().out == "on 3, then 1\n"
    assert rig.board.panel.outputs == GRIP
