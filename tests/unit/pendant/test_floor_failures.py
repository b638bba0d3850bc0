"""Pages at the pendant when something fails that nobody has foreseen: a full disk, a thread that cannot be started."""

from __future__ import annotations

import asyncio
import fcntl
import json
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from qrobot import transform_file
from qrobot.pendant.lease import SILENCE_S
from qrobot.pendant.live_socket import _obey, _tell
from qrobot.transform_file import TransformFile
from qrobot.wire import RobotState, State
from tests.support.patience import PATIENCE_S, give_time, wait_until
from tests.unit.pendant.test_floor import Floor, Q

FULL = OSError(28, "No space left on device")


def fail(*_arguments: Any, **_named: Any) -> None:
    raise FULL


@pytest.fixture
def floor(tmp_path: Path) -> Floor:
    floor = Floor(tmp_path, arms=2)
    for arm in (0, 1):
        floor.says(0, do="take", arm=arm)
    return floor


def test_a_page_is_told_of_it_and_still_drives_its_arms(floor: Floor) -> None:
    page = floor.pages[0]
    floor.station.programs.start = fail  # type: ignore[method-assign, assignment]
    request = {"do": "program start", "arm": 0, "name": "a.py", "manner": "offline"}
    _obey(floor, page, json.dumps(request))
    told = json.loads(floor.status(page))
    assert told["notice"] == "not done: No space left on device"
    assert [arm["driver"] for arm in told["arms"]] == [1, 1]


def test_stop_reaches_every_arm_whatever_fails_at_the_first(floor: Floor) -> None:
    floor.station.stop = fail  # type: ignore[method-assign]
    with pytest.raises(OSError, match="No space"):
        floor.says(1, do="stop")
    assert [json.loads(floor.status(page))["stops"] for page in floor.pages] == [0, 1]  # it was read
    assert floor.asked == [(1, "stop"), (1, {"do": "stop"})]


@pytest.mark.parametrize("failing", ["requests", "programs"])
def test_stop_does_each_of_its_steps_whatever_another_one_fails_by(
    floor: Floor, monkeypatch: pytest.MonkeyPatch, failing: str
) -> None:
    done: list[str] = []
    for part in ("programs", "procedures"):
        monkeypatch.setattr(getattr(floor.station, part), "stop", lambda part=part: done.append(part))
    monkeypatch.setattr(getattr(floor.station, failing), "stop", fail)
    with pytest.raises(OSError, match="No space"):
        floor.says(1, do="stop")
    assert done == [part for part in ("programs", "procedures") if part != failing]
    assert {"do": "stop"} in floor.asked


def test_a_page_that_sleeps_loses_its_other_arms_whatever_fails_at_the_first(floor: Floor) -> None:
    floor.station.leave_alone = fail  # type: ignore[method-assign]
    floor.now_s += SILENCE_S + 0.1
    floor.look_at_lease()
    assert floor.arms[1].lease.holder is None
    assert floor.asked[-1] == (1, {"do": "off"})


def test_no_place_is_recorded_of_an_arm_whose_counters_are_not_true(tmp_path: Path) -> None:
    floor = Floor(tmp_path)
    floor.says(0, do="take", arm=0)
    robot = RobotState(t_ns=0, mode=4, q=Q, v=(0.0,) * 6, tau=(0.0,) * 6, q_setpoint=Q, flags=5)
    floor.station.watch._tell(State(1, robot))
    floor.says(0, do="record", arm=0, name="HERE")
    assert "not calibrated" in floor.station.status["notice"]
    assert not (tmp_path / "t.db").exists()


def test_stop_is_heard_while_another_program_writes_the_file_of_places(
    floor: Floor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(transform_file, "_rest", give_time)
    monkeypatch.setattr(transform_file, "PATIENCE_S", PATIENCE_S)
    places, file = floor.station.places, TransformFile(tmp_path / "t.db")
    del places._changes.submit  # which does it at once for other tests
    place = {"do": "place", "arm": 0, "numbers": [500, 0, 300, 0, 180, 45]}
    with (tmp_path / "t.db.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        for name in ("A", "B"):
            assert floor.says(0, **place, name=name) == []
        assert "stop" in floor.says(1, do="stop")
        assert file.names() == []
    places.close()
    assert file.names() == ["A", "B"]


def test_pages_are_told_and_stop_is_heard_while_the_disk_below_the_file_of_places_hangs(
    floor: Floor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page, places, answers = floor.pages[0], floor.station.places, threading.Event()
    del places._changes.submit  # which does it at once for other tests
    stamp = places._stamp
    monkeypatch.setattr(places, "_stamp", lambda: stamp() if answers.wait(PATIENCE_S) else ())
    TransformFile(tmp_path / "t.db").write("D", np.eye(4))
    for _ in range(3):
        assert json.loads(floor.status(page))["arms"][0]["taught"] == {}
        assert "stop" in floor.says(1, do="stop")
    page.status_due = False
    answers.set()
    wait_until(lambda: page.status_due, "the page is told of the place")
    assert list(json.loads(floor.status(page))["arms"][0]["taught"]) == ["D"]
    places.close()
    assert list(floor.station.status["taught"]) == ["D"]  # a page may be there still


def test_the_status_that_acknowledges_a_stop_leaves_before_samples_that_come_faster_than_they_leave(
    floor: Floor,
) -> None:
    page, due, sent = floor.pages[0], asyncio.Event(), list[str]()

    class Socket:
        async def send_text(self, _text: str) -> None:
            sent.append("status")

        async def send_bytes(self, _frame: bytes) -> None:
            sent.append("sample")
            page.frames.append(b"the next one")
            if sent.count("sample") == 3:
                floor.says(0, do="stop")
            if sent.count("sample") > 9:
                raise ConnectionError

    page.frames.append(b"a sample")
    due.set()
    with pytest.raises(ConnectionError):
        asyncio.run(_tell(floor, page, Socket(), due))  # type: ignore[arg-type]
    assert sent == ["status", "status", *["sample"] * 3, "status", *["sample"] * 7]
