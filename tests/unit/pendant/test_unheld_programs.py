"""A program whose page has gone: a pause holds it, or it is ended."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.motion import motion_limits
from qrobot.motion.trajectory.speed_override import SpeedOverride
from qrobot.pendant.pause_watch import RAMP, REACH_S
from qrobot.wire import RobotFlag, RobotState, State
from tests.unit.pendant.test_floor import READY, START, Floor

STEP_S = 0.25
LONG_S = 60.0
ENDED = ["stop", "end"]
UNPAUSED = RobotFlag.POWERED | RobotFlag.CALIBRATED | RobotFlag.ESTOP_OK

Motion = Callable[[float], float]  # of joint 1, rad, by the time, s


def stands(_now_s: float) -> float:
    return 0.0


def moves(now_s: float) -> float:
    return 0.1 * now_s


def creeps(now_s: float) -> float:
    return 1e-3 * now_s


def swings(now_s: float) -> float:
    """There and back, and where it was at each look at it."""
    return 0.2 * float(np.sin(2.0 * np.pi * now_s))


def wakes_up(now_s: float) -> float:
    return 0.1 * max(0.0, now_s - 0.5 * LONG_S)


def test_the_longest_way_into_a_pause_is_over_before_the_arm_has_to_stand() -> None:
    robot = load_robot("puma560")
    limits, period_s = motion_limits(robot), 0.001
    override, samples = SpeedOverride(limits, period_s), 0
    while override.rate > 0.0:
        override.advance(1, 0.0)
        samples += 1
    assert samples * period_s == pytest.approx(RAMP * float((limits.v_max / limits.a_stop).max()), abs=0.01)


class ProgramFloor(Floor):
    """Arms that one live program of the first one moves, which the first page has started and left."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch, arms: int = 1) -> None:
        super().__init__(folder, arms)
        self.motions: list[Motion] = [stands] * arms
        self.paused, self.heard = [True] * arms, [True] * arms
        self.powered, self.path_waits = True, False  # of the first arm
        programs = self.station.programs
        monkeypatch.setattr(type(programs), "live", property(lambda each: self.runs and each is programs))
        monkeypatch.setattr(programs, "start", lambda *_: None)
        monkeypatch.setattr(programs, "end", lambda: self.asked.append("end"))
        self.runs = False
        for number in range(arms):
            self.hear(number, commanded=False)
            self.says(0, do="take", arm=number)
        self.says(0, **START)
        self.runs = True

    def leave_arms(self) -> None:
        """The page closes."""
        self.leave(self.pages[0])
        del self.asked[:]

    def hear(self, arm: int, commanded: bool = True) -> None:
        """A sample."""
        q = np.array(READY["q"])
        q[0] += self.motions[arm](self.now_s)
        flags = UNPAUSED | (RobotFlag.PAUSED if self.paused[arm] else 0)
        flags &= ~(0 if self.powered or arm else RobotFlag.POWERED)
        told = RobotState(**READY | {"q_setpoint": tuple(q), "flags": int(flags)})  # type: ignore[arg-type]
        self.arms[arm].watch._tell(State(1, told, commanded=commanded, path_waits=self.path_waits and not arm))

    def pass_time(self, seconds: float) -> list[object]:
        """What is asked for meanwhile."""
        del self.asked[:]
        for count in range(1, round(seconds / STEP_S) + 1):
            self.now_s += STEP_S
            for number in range(len(self.arms)):
                if self.heard[number]:
                    self.hear(number)
            if count % 4 == 0:
                self.look_at_lease()
        return list(self.asked)

    def keep_page(self, seconds: float) -> list[object]:
        """The same, with the second page awake."""
        asked: list[object] = []
        for _ in range(round(seconds)):
            self.says(1, do="alive")
            asked += self.pass_time(1.0)
        return asked


@pytest.fixture
def floor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ProgramFloor:
    return ProgramFloor(tmp_path, monkeypatch)


@pytest.mark.parametrize("motion", [moves, creeps, swings, wakes_up])
def test_an_arm_that_moves_in_spite_of_its_pause_while_no_page_drives_is_stopped_and_its_program_ended(
    floor: ProgramFloor, motion: Motion
) -> None:
    floor.leave_arms()
    floor.motions[0] = motion
    assert floor.pass_time(LONG_S)[:2] == ENDED
    assert "in spite of the pause" in floor.station.status["notice"]


@pytest.mark.parametrize(("heard", "why"), [(True, "has not heard of the pause"), (False, "nothing is heard")])
def test_a_program_of_which_nobody_knows_that_it_is_paused_is_ended(floor: ProgramFloor, heard: bool, why: str) -> None:
    floor.leave_arms()
    floor.paused[0], floor.heard[0] = False, heard
    assert floor.pass_time(LONG_S)[:2] == ENDED
    assert why in floor.station.status["notice"]


def test_a_program_that_stands_in_its_pause_is_left_alone_and_so_is_one_that_somebody_lets_go_on(
    floor: ProgramFloor,
) -> None:
    floor.leave_arms()
    assert floor.pass_time(LONG_S) == []
    floor.paused[0], floor.motions[0] = False, moves  # whoever types `qrobot ctl resume` looks at the arm
    assert floor.pass_time(LONG_S) == []
    floor.paused[0] = True
    assert floor.pass_time(LONG_S) == []


def test_a_servo_that_starts_anew_without_the_pause_is_nobody_s_word(floor: ProgramFloor) -> None:
    floor.leave_arms()
    assert floor.pass_time(0.5 * LONG_S) == []
    floor.paused[0] = floor.powered = False
    floor.hear(0)
    floor.powered, floor.motions[0] = True, moves  # the program has taken its arm again
    assert floor.pass_time(LONG_S)[:2] == ENDED


def test_whoever_confirms_the_way_back_to_a_path_that_waits_is_heeded_though_the_arm_has_no_power_yet(
    floor: ProgramFloor,
) -> None:
    floor.leave_arms()
    assert floor.pass_time(0.5 * LONG_S) == []
    floor.powered, floor.path_waits = False, True
    floor.hear(0)
    floor.paused[0] = floor.path_waits = False
    floor.hear(0)
    floor.powered, floor.motions[0] = True, moves
    assert floor.pass_time(LONG_S) == []


@pytest.mark.parametrize("paused_before", [False, True])
def test_somebody_may_let_a_program_go_on_before_it_has_to_stand(floor: ProgramFloor, paused_before: bool) -> None:
    floor.paused[0] = paused_before
    floor.hear(0)
    floor.leave_arms()
    floor.pass_time(0.5)
    floor.paused[0] = True
    assert floor.pass_time(REACH_S) == []
    floor.paused[0], floor.motions[0] = False, moves
    assert floor.pass_time(LONG_S) == []


@pytest.mark.parametrize("paused_again", [False, True])
def test_a_word_to_go_on_from_before_the_page_went_ends_no_pause_that_is_asked_for_behind_it(
    floor: ProgramFloor, paused_again: bool
) -> None:
    floor.hear(0)
    floor.leave_arms()
    floor.paused[0] = False
    floor.pass_time(STEP_S)
    floor.paused[0], floor.motions[0] = paused_again, moves
    assert floor.pass_time(LONG_S)[:2] == ENDED


def test_an_arm_that_comes_to_rest_in_its_pause_is_given_time_for_it(floor: ProgramFloor) -> None:
    floor.leave_arms()
    floor.motions[0] = lambda now_s: -((1.0 - min(now_s, 1.0)) ** 2)
    assert floor.pass_time(LONG_S) == []


def test_an_arm_that_another_page_drives_may_move(floor: ProgramFloor) -> None:
    floor.leave_arms()
    floor.says(1, do="take", arm=0)
    floor.motions[0], floor.paused[0] = moves, False
    assert floor.keep_page(LONG_S) == []
    floor.says(1, do="give", arm=0)
    assert floor.pass_time(LONG_S)[:2] == ENDED


def test_only_what_a_program_moves_is_the_programs(floor: ProgramFloor) -> None:
    """An arm without power is turned by hand; one whose program has ended is nobody's."""
    floor.leave_arms()
    hear = floor.hear
    floor.motions[0] = moves
    floor.hear = lambda arm, commanded=False: hear(arm, commanded)  # type: ignore[method-assign]
    assert floor.pass_time(LONG_S) == []
    floor.hear = hear  # type: ignore[method-assign]
    floor.runs = False
    assert floor.pass_time(LONG_S) == []


def test_a_program_that_goes_on_after_it_was_ended_is_stopped_again_and_not_at_each_look(floor: ProgramFloor) -> None:
    floor.leave_arms()
    floor.motions[0] = moves
    stops = floor.pass_time(LONG_S).count("stop")
    assert 2 < stops < LONG_S / 2


def test_a_program_of_two_arms_is_ended_when_the_one_that_no_page_drives_moves_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    floor = ProgramFloor(tmp_path, monkeypatch, arms=2)
    floor.leave_arms()
    assert floor.pass_time(LONG_S) == []
    floor.motions[1] = moves
    assert floor.pass_time(LONG_S)[:3] == ["stop", (1, "stop"), "end"]
    assert floor.arms[1].arm.name in floor.station.status["notice"]


def test_an_arm_that_the_program_reaches_and_does_not_command_is_none_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    floor = ProgramFloor(tmp_path, monkeypatch, arms=2)
    floor.leave_arms()
    hear = floor.hear
    floor.hear = lambda arm, commanded=False: hear(arm, commanded or arm == 0)  # type: ignore[method-assign]
    floor.motions[1] = moves
    assert floor.pass_time(LONG_S) == []
