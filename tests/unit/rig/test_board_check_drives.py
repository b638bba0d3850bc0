"""The walk through separate drives in place of a board: what they lack is left out, and wrong signs are found."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from qrobot.config import Robot
from qrobot.config.drives import DriveMode
from qrobot.rig.board_check import STEPS
from qrobot.rig.board_walk import Walk
from tests.support.drives import loops_for, served, torque_for
from tests.support.walk_desk import EVERYTHING, ROBOT, Desk, reversed_in

PERIOD_S = 0.002
NO_BOARD = dict.fromkeys(("index flags", "converter", "analogue outputs"), "left out: separate drives have none")
NO_TORQUE = dict.fromkeys(
    ("which way the joints go", "a push on each joint"), "left out: drives in position mode take no torque"
)


@contextmanager
def drives_desk(mode: DriveMode = "torque", told: Robot = ROBOT, polarity: int = 0) -> Iterator[Desk]:
    """A walk over drives of the emulated arm with the signs that `told` asks for.

    The drive of joint `polarity` gives torque by which its position falls.
    """
    desk = Desk(told)
    desk.end.steps = round(PERIOD_S * 1e9 / desk.emulator.bundle.period_ns)
    loops = loops_for(ROBOT, PERIOD_S) if mode == "position" else ()
    with served(desk.end, torque=torque_for(told), loops=loops) as drives:
        torque = enumerate(torque_for(ROBOT), 1)
        drives.far.torque_permille = tuple(-each if joint == polarity else each for joint, each in torque)
        desk.walk = Walk(drives.bus, told, desk.walk.ask, mode, now_ns=desk.now_ns)
        desk.answer = desk.by_hand(+1)
        yield desk


@pytest.mark.parametrize(("mode", "left_out"), [("torque", NO_BOARD), ("position", NO_BOARD | NO_TORQUE)])
def test_drives_pass_every_step_and_what_they_lack_is_left_out(mode: DriveMode, left_out: dict[str, str]) -> None:
    with drives_desk(mode) as desk:
        findings = desk.check(EVERYTHING)
        assert [finding.step for finding in findings] == [step.name for step in STEPS]
        assert {each.step: each.detail for each in findings if each.ok is not True} == left_out
        assert not any("voltmeter" in question for question in desk.asked)
        assert not desk.emulator.powered


@pytest.mark.sampled(1)
@pytest.mark.parametrize("joint", [2, 4])
def test_a_drive_whose_torque_lets_its_position_fall_is_found_by_a_push(joint: int) -> None:
    with drives_desk(polarity=joint) as desk:
        *_, last = desk.check(EVERYTHING)
        assert (last.step, last.ok) == ("a push on each joint", False), last
        assert last.detail == f"joint {joint} runs against its torque"
        assert "polarity of its drive" in last.remedy


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("joint", "step"), [(2, "which way the joints go"), (4, "encoders by hand")])
def test_counts_that_go_against_their_joint_are_a_matter_of_increments_per_count(joint: int, step: str) -> None:
    with drives_desk(told=reversed_in(joint, "count_sign")) as desk:
        *_, last = desk.check(EVERYTHING)
        assert (last.step, last.ok) == (step, False), last
        assert last.remedy == "change the sign of its increments_per_count and torque_permille"
