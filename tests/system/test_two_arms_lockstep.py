"""Two arms with servos and boards of their own under one program, on virtual time that passes for both alike."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
import pytest

from qrobot import rccl
from qrobot.errors import LinkBusy, ServoFault
from qrobot.modecodes import Mode
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.settings import ServoSettings
from tests.support.puma import PARK, ROBOT

SAMPLE_US = 28_000
SAMPLE_NS = SAMPLE_US * 1000
MEASURED = 0.01  # rad: the servo's error on the way


class Cell(NamedTuple):
    """Both arms."""

    rigs: list[LockstepRig]
    left: rccl.Channel
    right: rccl.Channel


@pytest.fixture
def cell() -> Iterator[Cell]:
    rigs = [LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0)) for _ in range(2)]
    free = iter(rigs)
    with rccl.use(lambda hello: link_factory(next(free), SAMPLE_US, hello)):
        left, right = rccl.control(), rccl.control()
        yield Cell(rigs, left, right)
        left.release()
        right.release()


def turned(arm: rccl.Channel, name: str, degrees: float) -> rccl.Position:
    return arm.jposition(name, np.degrees(PARK) + degrees * np.eye(6)[0])


def test_the_second_arm_begins_when_the_first_is_half_way_and_both_move_at_once(cell: Cell) -> None:
    giving, taking = turned(cell.left, "giving", 20.0), turned(cell.right, "taking", -15.0)
    cell.left.move(giving)
    cell.left.waitas(lambda: giving.scal > 0.5)
    assert cell.right.completed.count == 1
    cell.right.move(taking)
    cell.left.waitfor(giving.end)
    under_way = taking.scal
    assert 0.0 < under_way < 1.0  # time passed for the right arm while the program waited for the left one
    cell.right.waitfor(taking.end)
    cell.right.waitas(lambda begin=cell.right.time: cell.right.time > begin + 300)
    for rig, goal in zip(cell.rigs, (giving, taking), strict=True):
        rows = rig.rows()
        assert not rows["fault"].any()
        assert rig.emulator.q == pytest.approx(goal.q, abs=MEASURED)
    moving = [set(rows["t_ns"][np.abs(rows["v_ref"][:, 0]) > 0.05]) for rows in map(LockstepRig.rows, cell.rigs)]
    clocks = cell.rigs[0].now_ns - cell.rigs[1].now_ns
    assert len({t_ns - clocks for t_ns in moving[0]} & moving[1]) > 200  # cycles of a millisecond


def test_an_arm_that_is_commanded_is_refused_to_anybody_else(cell: Cell) -> None:
    with rccl.use(partial(link_factory, cell.rigs[0], SAMPLE_US)), pytest.raises(LinkBusy, match="is commanded by"):
        rccl.control()


def test_an_arm_nobody_waits_for_stays_in_step(cell: Cell) -> None:
    apart = cell.rigs[0].now_ns - cell.rigs[1].now_ns
    for arm in (cell.left, cell.right, cell.left):
        arm.waitas(lambda arm=arm, begin=arm.time: arm.time > begin + 1000)
        assert abs(cell.rigs[0].now_ns - cell.rigs[1].now_ns - apart) <= SAMPLE_NS
    assert {rig.rows()[-1]["mode"] for rig in cell.rigs} == {Mode.TRACKING}


def test_what_stops_one_arm_is_told_when_the_program_turns_to_it_and_the_other_goes_on(cell: Cell) -> None:
    goal = turned(cell.left, "goal", 10.0)
    cell.left.move(goal)
    cell.left.waitas(lambda: goal.scal > 0.3)
    cell.rigs[1].mailbox.request_stop()
    cell.left.waitfor(goal.end)
    assert goal.code == rccl.Termination.COMPLETED
    with pytest.raises(ServoFault, match="the servo stopped the arm"):
        cell.right.move(turned(cell.right, "never", 5.0))
