"""Which processes of a rig are started again, how often, and which end the rest; with processes that only pretend."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from qrobot.config.deployment import load_deployment
from qrobot.errors import LinkLost
from qrobot.rig.deployed import ArmProcesses
from qrobot.rig.log_trouble import LogTrouble
from qrobot.rig.processes import ProcessPlan
from qrobot.rig.restarts import WINDOW_S, Restarts


class Rig:
    """Children that have ended; notes what becomes of them."""

    def __init__(self) -> None:
        self.ended: list[Any] = []
        self.done: list[str] = []

    def end(self, plan: ProcessPlan) -> None:
        self.ended.append(SimpleNamespace(name=plan.name, plan=plan, complaint=lambda: "disk full"))

    def dead(self) -> list[Any]:
        ended, self.ended = self.ended, []
        return ended

    def restart(self, name: str) -> None:
        self.done.append(f"restart {name}")

    def forget(self, name: str) -> None:
        self.done.append(f"forget {name}")


class Scene:
    """A rig, its restarts, and a clock."""

    def __init__(self) -> None:
        self.rig, self.said, self.now_s = Rig(), list[str](), 0.0
        rig: Any = self.rig
        self.restarts = Restarts(rig, self.said.append, lambda: self.now_s)

    def ends(self, plan: ProcessPlan) -> str:
        """What is done about it."""
        self.rig.end(plan)
        self.restarts.look()
        return self.rig.done[-1]


LOG = ProcessPlan("a-log", [], restarts=3, vital=False)
BRIDGE = ProcessPlan("a-bridge", [], restarts=3)
SERVO = ProcessPlan("a-servo", [])


def test_a_log_is_started_again_three_times_a_minute_and_then_gone_without() -> None:
    scene = Scene()
    assert [scene.ends(LOG) for _ in range(4)] == ["restart a-log"] * 3 + ["forget a-log"]
    assert scene.said[0] == "a-log has ended: disk full; it is started again (1 of 3 times a minute)"
    assert "the rest goes on without it" in scene.said[-1]


def test_a_bridge_is_started_again_three_times_a_minute_and_then_the_rest_is_ended() -> None:
    scene = Scene()
    assert [scene.ends(BRIDGE) for _ in range(3)] == ["restart a-bridge"] * 3
    with pytest.raises(LinkLost, match="a-bridge has ended: disk full"):
        scene.ends(BRIDGE)


def test_what_ends_now_and_then_is_started_again_for_ever() -> None:
    scene = Scene()
    for _ in range(20):
        assert scene.ends(BRIDGE) == "restart a-bridge"
        scene.now_s += 0.4 * WINDOW_S


def test_each_process_is_counted_by_itself() -> None:
    scene = Scene()
    for _ in range(3):
        scene.ends(BRIDGE)
        assert scene.ends(LOG) == "restart a-log"


def test_a_process_that_holds_the_arm_ends_the_rest_at_once() -> None:
    scene = Scene()
    with pytest.raises(LinkLost, match="a-servo has ended"):
        scene.ends(SERVO)
    assert scene.rig.done == []


def test_of_an_arm_only_bridge_and_log_are_started_again() -> None:
    rig: Any = None
    processes = ArmProcesses(rig, "emulator", load_deployment("emulator").arm[0])
    plans = [processes.board(), processes.servo(), processes.guardian(), processes.bridge(), processes.log()]
    assert [(plan.restarts, plan.vital) for plan in plans] == [(0, True)] * 3 + [(3, True), (3, False)]


def test_a_log_whose_disk_is_full_is_told_once() -> None:
    told: list[str] = []
    lines = ["", "the log is behind: 0 cycles lost, 1 refusals by the disk", "the log is behind: 9 cycles lost"]
    child: Any = SimpleNamespace(name="a-log", output="a-log.txt", complaint=lambda: lines.pop(0))
    trouble = LogTrouble(told.append)
    for _ in range(3):
        trouble.look([child])
    assert told == ["a-log: the log is behind: 0 cycles lost, 1 refusals by the disk; more of it stands in a-log.txt"]


def test_a_log_whose_end_is_not_on_the_disk_is_told_when_all_has_ended() -> None:
    told: list[str] = []
    lines = {"a-log": "the disk did not take its last 7 bytes (no space)", "b-log": "9 cycles, 0 lost", "c": "killed"}
    children: Any = [SimpleNamespace(name=name, complaint=lambda line=line: line) for name, line in lines.items()]
    LogTrouble(told.append).look_back(children)
    assert told == ["a-log: the disk did not take its last 7 bytes (no space)"]
