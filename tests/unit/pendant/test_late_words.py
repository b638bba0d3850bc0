"""Words of a page that may move an arm and have lain in the network."""

from __future__ import annotations

from typing import Any

import pytest

from qrobot.errors import MotionError
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


def test_an_arm_is_slowed_down_however_late_that_comes(floor: Floor, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(floor.station.requests, "override", floor.asked.append)
    floor.says(0, do="take", arm=0)
    floor.station.watch._tell(State(1, RobotState(**READY | {"t_ns": 9_000_000_000, "override": 0.4})))  # type: ignore[arg-type]
    assert floor.says(0, **SLOW | {"heard_s": 1.0}) == [0.3]
    assert floor.says(0, **SLOW) == [0.3]
