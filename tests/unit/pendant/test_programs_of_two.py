"""A program of several arms at the pendant: which of them it reaches, and who takes it back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from qrobot.wire import RobotState, State
from tests.unit.pendant.test_floor import READY, START, Floor


def test_power_off_ends_the_program_of_another_arm_that_may_still_power_the_arm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    floor = Floor(tmp_path, arms=3)
    for arm in floor.arms:
        monkeypatch.setattr(arm.programs, "start", lambda *_: None)
        arm.watch._tell(State(1, RobotState(**READY)))  # type: ignore[arg-type]
    moving = floor.arms[0].programs
    monkeypatch.setattr(moving, "end", lambda: floor.asked.append("end"))
    for number in (0, 1):
        floor.says(0, do="take", arm=number)
    floor.says(0, **START)
    assert "end" not in floor.says(1, do="act", arm=1, name="power off")  # nothing runs
    monkeypatch.setattr(type(moving), "live", property(lambda programs: programs is moving))
    assert "end" not in floor.says(1, do="act", arm=2, name="power off")  # the program does not reach it
    assert floor.says(1, do="act", arm=1, name="power off")[-1] == "end"
    assert "powered off" in floor.station.status["notice"]
    floor.arms[1].watch._tell(State(1, RobotState(**READY), commanded=True))  # type: ignore[arg-type]
    assert "end" not in floor.says(1, do="act", arm=1, name="power off")  # one that keeps its path waits on it


@pytest.mark.parametrize("off", [0, 1])
@pytest.mark.parametrize("own", ["ready", "opening", "calibrates", "unheard"])
def test_a_program_is_ended_by_power_off_at_an_arm_that_the_pendant_itself_commands(
    own: str, off: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    floor = Floor(tmp_path, arms=2)
    moving = floor.arms[0].programs
    for number, arm in enumerate(floor.arms):
        monkeypatch.setattr(arm.programs, "start", lambda *_: None)
        monkeypatch.setattr(arm.procedures, "end", lambda: None)
        arm.watch._tell(State(1, RobotState(**READY)))  # type: ignore[arg-type]
        floor.says(0, do="take", arm=number)
    monkeypatch.setattr(moving, "end", lambda: floor.asked.append("end"))
    floor.says(0, **START)
    monkeypatch.setattr(type(moving), "live", property(lambda programs: programs is moving))
    arm = floor.arms[off]
    arm.watch._tell(State(1, RobotState(**READY), commanded=True))  # type: ignore[arg-type]
    assert "end" not in floor.says(1, do="act", arm=off, name="power off")  # the program commands it
    if own == "calibrates":
        monkeypatch.setattr(type(arm.procedures), "live", property(lambda procedures: procedures is arm.procedures))
    elif own == "unheard":
        arm.watch.problem = "the bridge does not answer"
    else:
        arm.worker.session = own
    assert "end" in floor.says(1, do="act", arm=off, name="power off")


@pytest.mark.parametrize(("state", "why"), [({"flags": 4}, "not calibrated"), ({"fault": 1}, "clear the fault")])
def test_a_live_program_reaches_no_other_arm_that_is_not_ready_as_its_own_has_to_be(
    state: dict[str, Any], why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    floor = Floor(tmp_path, arms=2)
    own, other = floor.arms
    monkeypatch.setattr(own.programs, "start", lambda _, bridges, _place: floor.asked.append(bridges))
    for number, arm in enumerate(floor.arms):
        arm.watch._tell(State(1, RobotState(**READY)))  # type: ignore[arg-type]
        floor.says(0, do="take", arm=number)
    assert floor.says(0, **START) == [[own.bridge, other.bridge]]
    other.watch._tell(State(1, RobotState(**READY | state)))  # type: ignore[arg-type]
    assert floor.says(0, **START) == [[own.bridge]]
    assert why in own.status["notice"]
    assert floor.says(0, **START | {"manner": "offline"}) == [[own.bridge, other.bridge]]  # which moves none
    other.watch._tell(State(1, RobotState(**READY)))  # type: ignore[arg-type]
    assert floor.says(0, **START | {"name": "recorded/lesson.csv"}) == [[own.bridge]]  # which is of one arm
    assert why not in own.status["notice"]
