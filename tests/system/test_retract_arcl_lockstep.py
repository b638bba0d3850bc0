"""A tool comes down on a table in lock-step, moved by ARCL, in Python and C, or VAL's monitor: it goes back a little.

`test_retract_lockstep.py` has the same of RCCL.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from qrobot import rci
from qrobot.arcl import (
    ARCL_AMI,
    EVENT_DONE,
    MOV_TIME,
    Motion,
    arcl_close,
    arcl_collision,
    arcl_keep_path,
    arcl_kept,
    arcl_open,
    arcl_resume,
    arcl_retract,
    arcl_wait,
    joint_pos,
    move,
)
from qrobot.arcl.kinematics import kinematics
from qrobot.arcl.robot import ArclRobot
from qrobot.errors import ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.rig.lockstep import link_factory
from qrobot.val.interpreter import Interpreter
from qrobot.val.monitor import ValMonitor
from tests.support.arcl import run_c
from tests.support.c_programs import compiled, needs_compiler
from tests.support.collision_table import BELOW, END, Table
from tests.support.puma import ROBOT
from tests.support.val_storms import arm_in_lockstep

pytestmark = pytest.mark.usefixtures("arcl_alone")

BACK_MM = 25
SECONDS = 0.7  # for the ten centimetres from above the table to below it
DOWN = np.degrees(END - kinematics(ROBOT, "").zero)
LOWEST, HIGHEST = 0.018, 0.027  # m: where the tip is then


@contextmanager
def above_a_table() -> Iterator[tuple[Table, ArclRobot]]:
    one = Table(every=14)
    with rci.use(partial(link_factory, one, 28_000)):
        yield one, arcl_open(ARCL_AMI, "bridge")


def go_down(rp: ArclRobot) -> Motion:
    return move(rp, joint_pos(rp, "DOWN", DOWN.tolist()), MOV_TIME, int(1e3 * SECONDS), 0)


def rests_off_the_table(one: Table) -> None:
    one.run_for(0.3)
    assert LOWEST < one.tip_m() < HIGHEST
    assert one.forces[-1] == 0.0


@pytest.mark.parametrize("reaction", ["stop", "comply"])
def test_after_a_collision_the_arm_goes_back_by_the_way_it_came_and_the_program_is_told(reaction: str) -> None:
    with above_a_table() as (one, rp):
        arcl_collision(rp, reaction)
        arcl_retract(rp, BACK_MM)
        go_down(rp)
        with pytest.raises(ServoFault) as told:
            arcl_wait(rp)
        assert told.value.code == FaultCode.COLLISION
        rests_off_the_table(one)


def test_motions_that_are_kept_wait_off_what_was_met_and_go_on_when_that_is_gone() -> None:
    with above_a_table() as (one, rp):
        arcl_keep_path(rp)
        arcl_retract(rp, BACK_MM)
        motion = go_down(rp)
        arcl_wait(rp, lambda: arcl_kept(rp))
        assert LOWEST < one.tip_m() < HIGHEST
        assert "COLLISION" in arcl_kept(rp)
        one.take_table_away()
        arcl_resume(rp)
        arcl_wait(rp)
        assert motion.code is EVENT_DONE
        arcl_close(rp)
        assert one.tip_m() == pytest.approx(-BELOW, abs=0.003)


IN_C = f"""\
#include <arcl.h>
#include <stdio.h>
int main(void)
{{
    ROBOT *rp = arcl_open(ARCL_AMI, "bridge", 0);
    arcl_retract(rp, {BACK_MM}.);
    move(rp, joint_pos(rp, "DOWN", {", ".join(f"{angle:.9f}" for angle in DOWN)}), MOV_TIME, {int(1e3 * SECONDS)}, 0);
    arcl_wait(rp);
    printf("it went through\\n");
    return 0;
}}
"""


@needs_compiler
@pytest.mark.usefixtures("own_cache")
def test_a_program_in_c_has_its_arm_go_back_before_it_is_told(tmp_path: Path, capfd) -> None:
    (tmp_path / "down.c").write_text(IN_C)
    one, program = Table(every=14), compiled(tmp_path / "down.c", tmp_path)
    with rci.use(partial(link_factory, one, 28_000)):
        assert run_c(program, tmp_path, ami="bridge") == 1
    told = capfd.readouterr()
    assert "COLLISION" in told.err
    assert told.out == ""
    rests_off_the_table(one)


@contextmanager
def monitor_above_a_table(library: str) -> Iterator[tuple[Table, ValMonitor, Callable[[], str]]]:
    """A monitor that lets the arm go back from what it meets, and the command by which it comes down on the table."""
    one = Table(every=14)
    with arm_in_lockstep(one, library) as arm:
        monitor = ValMonitor(Interpreter(arm, lambda _line: None, lambda _question: ""))
        monitor.obey("SPEED 30")
        assert monitor.obey(f"RETRACT {BACK_MM}") == ""
        yield one, monitor, lambda: monitor.obey(f"DO MOVE #PPOINT({','.join(map(str, np.degrees(END)))})")


@pytest.mark.parametrize("library", ["rccl", "arcl"])
def test_the_monitor_of_val_has_a_step_wait_off_what_was_met_and_proceed_does_the_rest(library: str) -> None:
    with monitor_above_a_table(library) as (one, monitor, go):
        assert "COLLISION" in go()
        assert LOWEST < one.tip_m() < HIGHEST
        assert monitor.obey("STATUS").startswith("paused")
        one.take_table_away()
        assert monitor.obey("PROCEED") == "completed"
        assert one.tip_m() == pytest.approx(-BELOW, abs=0.003)


@pytest.mark.parametrize("library", ["rccl", "arcl"])
def test_ctrl_c_on_the_way_back_from_what_was_met_stops_the_arm_there(library: str) -> None:
    with monitor_above_a_table(library) as (one, monitor, go):
        arm = monitor._machine.arm
        sample = arm.sample

        def sampled() -> None:
            sample()
            if arm.off_path and one.tip_m() > 0.002:
                arm.sample = sample  # type: ignore[method-assign]
                raise KeyboardInterrupt

        arm.sample = sampled  # type: ignore[method-assign]
        assert "interrupted" in go()
        assert 0.002 < one.tip_m() < 0.01
        assert "COLLISION" in arm.kept
        one.take_table_away()
        assert monitor.obey("PROCEED") == "completed"
        assert one.tip_m() == pytest.approx(-BELOW, abs=0.003)


def test_a_way_back_that_cannot_be_is_refused_and_another_may_be_told_while_the_arm_waits() -> None:
    with monitor_above_a_table("rccl") as (one, monitor, go):
        for wrong in ("", "-1", "301", "nan", "far", "1, 2"):
            assert monitor.obey(f"RETRACT {wrong}") == "error: expected RETRACT and a number from 0 to 300"
        assert "RETRACT is 0 to 300 mm, not 301" in monitor.obey("DO PARAMETER RETRACT = 301")
        assert monitor.obey("DO PARAMETER RETRACT = 10") == ""
        assert "COLLISION" in go()
        assert monitor.obey("RETRACT 0") == ""
        one.take_table_away()
        assert monitor.obey("PROCEED") == "completed"
