"""Robots of ARCL are let go of once, at rest and with nothing in their queues, whatever functions of the program do."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Final

import pytest

from qrobot.arcl import (
    EVENT_BEGIN,
    EVENT_DONE,
    EVENT_STOP,
    MOV_NOTIFY,
    OK,
    ArclRobot,
    Motion,
    arcl_close,
    arcl_wait,
    joint_pos,
    move,
)
from qrobot.arcl.events import ArclEvent
from qrobot.arcl.opened import newest, open_robots
from qrobot.arcl.program import end_all
from qrobot.errors import LinkError
from qrobot.rci.bad_end import stop_all
from tests.support.arcl import PARK, offline

pytestmark = pytest.mark.usefixtures("arcl_alone")

WAITING: Final = 3
AWAY: Final = (30.0, *PARK[1:])
DROPPED: Final = "told that it was dropped"


def closings(robots: list[ArclRobot], monkeypatch: pytest.MonkeyPatch) -> list[tuple[ArclRobot, bool]]:
    """The robots that are let go of from here on, and whether they move then."""
    seen: list[tuple[ArclRobot, bool]] = []
    for rp in robots:
        close = rp.ami.close

        def noted(power_off: bool, rp: ArclRobot = rp, close: Callable[[bool], None] = close) -> None:
            seen.append((rp, rp.moving))
            close(power_off)

        monkeypatch.setattr(rp.ami, "close", noted)
    return seen


@pytest.mark.parametrize("well", [True, False], ids=["well", "badly"])
@pytest.mark.parametrize("let_go", [arcl_close, ArclRobot.close, ArclRobot.abandon])
def test_a_robot_that_the_program_has_let_go_of_makes_no_error_of_its_end(
    let_go: Callable[[ArclRobot], None], well: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    rp, other = offline(), offline()
    seen = closings([rp, other], monkeypatch)
    move(rp, joint_pos(rp, "away", AWAY), 0)
    let_go(rp)
    goes_on = move(other, joint_pos(other, "away", AWAY), 0)
    end_all(well)
    assert seen == [(rp, False), (other, False)]
    assert goes_on.code == (EVENT_DONE if well else EVENT_STOP)


class Hearer:
    """A function of MOV_NOTIFY that raises when it is told the `nth` time that a motion was dropped."""

    def __init__(self, nth: int) -> None:
        self.nth = nth
        self.told: list[ArclEvent] = []

    def __call__(self, event: ArclEvent, _: ArclRobot) -> object:
        self.told.append(event)
        if event == EVENT_STOP and self.told.count(EVENT_STOP) == self.nth:
            raise ValueError(DROPPED)
        return OK


def under_way(hearer: Callable[[ArclEvent, ArclRobot], object]) -> tuple[ArclRobot, list[Motion]]:
    """A robot on its way, and the motions that wait behind that one, of which `hearer` is told."""
    rp = offline()
    move(rp, joint_pos(rp, "first", (120.0, *PARK[1:])), 0)
    rp.wait(lambda: rp.treal > 500.0)
    behind = [move(rp, joint_pos(rp, "behind", PARK), MOV_NOTIFY, hearer, 0) for _ in range(WAITING)]
    assert rp.waiting == WAITING
    assert rp.moving
    return rp, behind


def stopped(rp: ArclRobot) -> None:
    with pytest.raises(ValueError, match=DROPPED):
        rp.stop()


def begun_to_stop(rp: ArclRobot) -> None:
    rp.begin_stop()


def abandoned(rp: ArclRobot) -> None:
    with pytest.raises(ValueError, match=DROPPED):
        rp.abandon()


@pytest.mark.parametrize("nth", range(1, WAITING + 1))
@pytest.mark.parametrize("stop", [stopped, begun_to_stop, abandoned])
def test_a_function_that_raises_keeps_no_motion_in_the_queue_and_the_arm_comes_to_rest(
    stop: Callable[[ArclRobot], None], nth: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    hearer = Hearer(nth)
    rp, behind = under_way(hearer)
    seen = closings([rp], monkeypatch)
    stop(rp)
    assert hearer.told == [EVENT_STOP] * WAITING
    assert [motion.code for motion in behind] == [EVENT_STOP] * WAITING
    if stop is not abandoned:
        assert rp.waiting == 0
        arcl_wait(rp)
        rp.abandon()
    assert EVENT_BEGIN not in hearer.told
    assert seen == [(rp, False)]


@pytest.mark.parametrize("let_go", [arcl_close, ArclRobot.close, ArclRobot.abandon])
def test_a_robot_that_was_let_go_of_is_no_open_one(let_go: Callable[[ArclRobot], None]) -> None:
    first, second = offline(), offline()
    assert open_robots() == [first, second]
    let_go(first)
    assert open_robots() == [second]
    let_go(second)
    with pytest.raises(LinkError, match="no robot is open"):
        newest()


@pytest.mark.parametrize("error", [SystemExit, KeyboardInterrupt, ValueError])
@pytest.mark.parametrize("raises", [0, 1])
def test_a_function_that_ends_the_program_when_all_stop_keeps_no_other_robot_from_its_stop(
    raises: int, error: type[BaseException]
) -> None:
    def ends(event: ArclEvent, _: ArclRobot) -> object:
        if event == EVENT_STOP:
            raise error
        return OK

    robots = [under_way(ends if number == raises else Hearer(0))[0] for number in (0, 1)]
    with suppress(error):
        stop_all()
    assert [rp.waiting for rp in robots] == [0, 0]
    for rp in robots:
        arcl_wait(rp)
        assert rp.joints[0] < 120.0
        rp.abandon()
