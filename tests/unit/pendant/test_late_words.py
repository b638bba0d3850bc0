"""Words of a page that may move an arm and have lain in the network."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from qrobot.errors import MotionError
from qrobot.pendant.arm_station import HELD_LATE_S
from qrobot.pendant.held_press import BEAT_S, PATIENCE_S, HeldPress, Press
from qrobot.wire import RobotState, State
from tests.unit.pendant.test_floor import READY, START, Floor, floor

__all__ = ["floor"]  # the fixture

LATE: list[dict[str, Any]] = [
    START,
    {"do": "procedure start", "arm": 0, "step": "calibrate", "confirmed": True},
    {"do": "program say", "arm": 0, "line": "PROCEED"},
    {"do": "procedure start", "arm": 0, "step": "record live", "confirmed": True},
    *({"do": "act", "arm": 0, "name": name} for name in ("resume", "power on", "clear", "tare")),
    {"do": "command", "arm": 0, "on": True},
    {"do": "override", "arm": 0, "factor": 0.5},
    {"do": "hand", "arm": 0, "opened": True},
]
TARGETS = [("joint", "2"), ("axis", "dx"), ("place", "park"), ("guide", "hand")]
PRESSES: list[dict[str, Any]] = [
    {"do": "press", "arm": 0, "number": 1, "target": target, "name": name} for target, name in TARGETS
]
BEAT: dict[str, Any] = {"do": "beat", "arm": 0, "number": 1}
SLOW = {"do": "override", "arm": 0, "factor": 0.3}


@pytest.mark.parametrize("message", LATE, ids=lambda message: message["do"])
def test_a_word_that_lay_in_the_network_moves_no_arm(
    floor: Floor, monkeypatch: pytest.MonkeyPatch, message: dict[str, Any]
) -> None:
    monkeypatch.setattr(floor.station.programs, "start", lambda *_: floor.asked.append("start"))
    monkeypatch.setattr(floor.station.programs, "say", floor.asked.append)
    monkeypatch.setattr(floor.station.procedures, "start", floor.asked.append)
    monkeypatch.setattr(floor.station.requests, "override", floor.asked.append)
    floor.says(0, do="take", arm=0)
    floor.station.watch._tell(State(1, RobotState(**READY | {"t_ns": 9_000_000_000, "override": 0.4})))  # type: ignore[arg-type]
    if message["do"] == "program say":
        monkeypatch.setattr(type(floor.station.programs), "live", True)
    for heard_s in (7.9, 10.1, None):
        with pytest.raises(MotionError, match="it came late"):
            floor.says(0, **message | {"heard_s": heard_s})
        assert floor.asked == []
    assert floor.says(0, **message | {"heard_s": 8.1}) != []


@pytest.mark.parametrize("message", PRESSES, ids=lambda message: message["target"])
def test_a_press_that_lay_in_the_network_moves_no_arm_and_lets_go_of_what_is_held(
    floor: Floor, message: dict[str, Any]
) -> None:
    floor.says(0, do="take", arm=0)
    floor.station.watch._tell(State(1, RobotState(**READY | {"t_ns": 9_000_000_000})))  # type: ignore[arg-type]
    for heard_s in (8.4, 9.6, None):
        with pytest.raises(MotionError, match="it came late"):
            floor.says(0, **message | {"heard_s": heard_s})
        assert floor.asked == [{"do": "release"}]
        assert floor.says(0, **BEAT | {"heard_s": heard_s}) == []
    release, press = floor.says(0, **message | {"heard_s": 8.6})
    assert (release["do"], press["do"], press["name"]) == ("release", "press", message["name"])
    assert floor.says(0, **BEAT | {"heard_s": 8.6}) == [{"do": "beat", "number": 1}]


def test_a_word_is_late_by_the_newest_sample_and_the_time_since_then_also_when_no_other_one_comes(floor: Floor) -> None:
    """As that of a bridge that has gone; the servo, which does these words, is there."""
    power_on: dict[str, Any] = {"do": "act", "arm": 0, "name": "power on", "heard_s": 9.0}
    floor.says(0, do="take", arm=0)
    floor.station.watch._tell(State(1, RobotState(**READY | {"t_ns": 9_000_000_000})))  # type: ignore[arg-type]
    floor.now_s += 0.9
    assert floor.says(0, **power_on) == ["power on"]
    floor.now_s += 0.2
    with pytest.raises(MotionError, match="nothing is heard of the arm"):
        floor.says(0, **power_on)
    floor.station.watch._tell(State(1, RobotState(**READY | {"t_ns": 10_100_000_000})))  # type: ignore[arg-type]
    assert floor.says(0, **power_on | {"heard_s": 9.2}) == ["power on"]


class SlowLine:
    """A page at an arm that tells of itself each 10 ms: words take `way_s(t)` each way, in order. Virtual time."""

    STEP_S = 0.01

    def __init__(self, floor: Floor, way_s: Callable[[float], float]) -> None:
        self.floor, self.way_s, self.now_s, self.heard_s = floor, way_s, 0.0, 0.0
        self.press = HeldPress()
        self.moves: list[float] = []  # instants at which the arm moves
        self.told = 0
        self._down: deque[tuple[float, float]] = deque()  # samples on their way to the page: when they come, of when
        self._up: deque[tuple[float, dict[str, Any]]] = deque()
        floor.station.worker.say = self._obey  # type: ignore[method-assign]
        floor.says(0, do="take", arm=0)

    def run(self, press_s: float, release_s: float, end_s: float) -> None:
        """Hold a button from one instant to another one, as `link.js` does."""
        presses, releases, end = (round(instant / self.STEP_S) for instant in (press_s, release_s, end_s))
        for k in range(end):
            self.now_s = k * self.STEP_S
            self._carry()
            if k == presses:
                self._say(PRESSES[0])
            elif k == releases:
                self._say({"do": "release"})
            elif presses < k < releases and (k - presses) % round(BEAT_S / self.STEP_S) == 0:
                self._say(BEAT)
            if self.press.held(self.now_s):
                self.moves.append(self.now_s)

    def _say(self, message: dict[str, Any]) -> None:
        heard = {} if message["do"] == "release" else {"heard_s": self.heard_s}
        self._up.append((self.now_s + self.way_s(self.now_s), message | heard))

    def _carry(self) -> None:
        newest = RobotState(**READY | {"t_ns": round(self.now_s * 1e9)})  # type: ignore[arg-type]
        self.floor.station.watch._tell(State(1, newest))
        self._down.append((self.now_s + self.way_s(self.now_s), self.now_s))
        while self._down and self._down[0][0] <= self.now_s:
            self.heard_s = self._down.popleft()[1]
        while self._up and self._up[0][0] <= self.now_s:
            try:
                self.floor.says(0, **self._up.popleft()[1])
            except MotionError:
                self.told += 1

    def _obey(self, **message: Any) -> None:
        match message.pop("do"):
            case "press":
                self.press.begin(Press(**message), self.now_s)
            case "beat":
                self.press.beat(message["number"], self.now_s)
            case "release":
                self.press.end()


@pytest.mark.parametrize("way_s", [0.0, 0.1, 0.2])
def test_a_held_button_moves_the_arm_over_a_line_that_takes_less_than_half_a_second_there_and_back(
    floor: Floor, way_s: float
) -> None:
    line = SlowLine(floor, lambda _: way_s)
    line.run(1.0, 2.0, 5.0)
    assert line.told == 0
    assert line.moves[0] == pytest.approx(1.0 + way_s, abs=0.011)
    assert line.moves[-1] == pytest.approx(2.0 + way_s, abs=0.021)
    assert len(line.moves) == pytest.approx(100, abs=3)


@pytest.mark.parametrize("way_s", [0.3, 0.6, 2.0])
@pytest.mark.parametrize("held_s", [0.1, 1.0, 5.0])
def test_a_held_button_moves_no_arm_over_a_line_that_takes_longer(floor: Floor, way_s: float, held_s: float) -> None:
    """However long it is held, and after it is let go."""
    line = SlowLine(floor, lambda _: way_s)
    line.run(3.0, 3.0 + held_s, 15.0)
    assert line.moves == []
    assert line.told == 1


@pytest.mark.parametrize("growth", [0.05, 0.2, 1.0, 5.0])
@pytest.mark.parametrize("held_s", [0.5, 1.5, 8.0])
def test_an_arm_does_not_move_on_when_a_line_becomes_slow_while_its_button_is_held(
    floor: Floor, growth: float, held_s: float
) -> None:
    """Each second the line takes so much longer; words stay in order, and no gap need be seen."""
    line = SlowLine(floor, lambda now_s: growth * max(0.0, now_s - 1.0))
    line.run(1.0, 1.0 + held_s, 15.0)
    assert 0.0 < line.moves[-1] - 1.0 < held_s + HELD_LATE_S + PATIENCE_S
    assert np.diff(line.moves).max(initial=0.0) < 0.011  # and never anew


def test_an_arm_is_slowed_down_however_late_that_comes(floor: Floor, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(floor.station.requests, "override", floor.asked.append)
    floor.says(0, do="take", arm=0)
    floor.station.watch._tell(State(1, RobotState(**READY | {"t_ns": 9_000_000_000, "override": 0.4})))  # type: ignore[arg-type]
    assert floor.says(0, **SLOW | {"heard_s": 1.0}) == [0.3]
    assert floor.says(0, **SLOW) == [0.3]
