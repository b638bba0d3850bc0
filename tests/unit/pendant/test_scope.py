"""The scope of the pendant: every cycle of a servo's ring, by windows and by triggers, and no word written to it."""

from __future__ import annotations

import json
import os
from typing import Any

import numpy as np
import pytest

from qrobot.faultcodes import FaultCode
from qrobot.log.ring_history import EVENT, CycleTrigger, RingHistory
from qrobot.log.windows import QUANTITIES, quantities_of
from qrobot.modecodes import Mode
from qrobot.pendant.scope_process import MOST_KEPT, ScopeRings
from qrobot.servo.memory.servo_memory import ServoSegment, create_servo_memory, telemetry_ring
from qrobot.servo.memory.telemetry import Rows, TelemetryLayout, append_row
from tests.support.log_samples import PERIOD_NS, START_NS, Ring, make_rows

N = 2
CAPACITY = 4096
PERIOD_S = PERIOD_NS * 1e-9
JOINTS = ["waist", "lift"]
ARM = f"scope-{os.getpid()}"


def seconds_of(tick: int) -> float:
    return START_NS * 1e-9 + tick * PERIOD_S


def append(servo: ServoSegment, rows: Rows) -> None:
    row_words = TelemetryLayout(N).row_words
    for row in rows.view(np.int64).reshape(rows.size, row_words):
        append_row(telemetry_ring(servo.words, N), 0, CAPACITY, row_words, row)


def new_servo() -> ServoSegment:
    servo = create_servo_memory(ARM, "puma560", "pd", N, PERIOD_NS, CAPACITY)
    servo.front.info.ready = 1
    return servo


class Asked:
    """Questions as pages ask them; an answer has its curves beside what is told."""

    def __init__(self) -> None:
        self._desk = ScopeRings()

    def __call__(self, do: str, **request: Any) -> Any:
        told, data = self._desk.answer(json.loads(json.dumps({"do": do, **request})))
        if do == "csv" and not told:
            return data.decode()
        if data:
            m = len(data) // (8 + 3 * 4 * 5 * N)
            told["t"] = np.frombuffer(data, "<f8", m)
            told["low"], told["high"], told["first"] = np.frombuffer(data, "<f4", offset=8 * m).reshape(3, m, 5 * N)
        return told

    def look(
        self, seconds: float, points: int = 4000, trigger: Any = None, after: int = 0, before: float = 0.25
    ) -> Any:
        return self("look", arm=ARM, seconds=seconds, points=points, trigger=trigger, after=after, before=before)


@pytest.fixture
def asked() -> Asked:
    return Asked()


def test_a_picture_has_every_cycle_of_its_window_and_no_peak_is_lost_when_it_has_fewer_instants(asked: Asked) -> None:
    rows = make_rows(3000, N)
    rows["tau"][2500, 1] = 77.0  # one cycle
    servo = new_servo()
    try:
        append(servo, rows)
        before = servo.words.tobytes()
        exact = asked.look(0.05)
        assert (exact["cycles"], exact["rate_hz"], exact["newest"]) == (201, 4000.0, 2999)
        np.testing.assert_allclose(exact["t"], [seconds_of(tick) for tick in range(2799, 3000)], atol=1e-9)
        for name in ("low", "high", "first"):
            np.testing.assert_array_equal(exact[name], quantities_of(rows[-201:]).astype("f4"))
        thin = asked.look(0.5, points=50)
        assert len(thin["t"]) <= 50
        assert thin["high"][:, QUANTITIES.index("torque") * N + 1].max() == 77.0
        assert servo.words.tobytes() == before  # it is only read
    finally:
        servo.close(unlink=True)


def test_a_trigger_shows_the_cycles_around_the_first_that_meets_it_and_only_those_after_it_was_armed(
    asked: Asked,
) -> None:
    rows = make_rows(3000, N)
    rows["q"] = rows["q_ref"]
    rows["q"][1000:1010, 1] -= 0.3
    rows["q"][2000:2010, 1] -= 0.3
    rows["mode"][2500:] = Mode.HOLDING
    rows["fault"][2500:], rows["event_joint"][2500:] = FaultCode.FOLLOWING, 1
    error = {"quantity": "error", "joint": 1, "rising": True, "level": 0.2}
    servo = new_servo()
    try:
        append(servo, rows)
        for after, cycle in ((0, 1000), (999, 1000), (1000, 2000), (2000, None)):
            found = asked.look(0.1, trigger=error, after=after)
            assert found["triggered"] == (None if cycle is None else pytest.approx(seconds_of(cycle))), after
        found = asked.look(0.1, trigger=error)
        assert (found["begin"], found["end"]) == pytest.approx((seconds_of(900), seconds_of(1300)), abs=PERIOD_S)
        assert asked.look(0.1, trigger=error | {"rising": False, "level": -0.1})["triggered"] is None
        assert asked.look(0.1, trigger=error | {"rising": False, "level": 0.1})["triggered"] == pytest.approx(
            seconds_of(1010)
        )
        event = asked.look(1.0, trigger={"quantity": EVENT})
        assert event["triggered"] == pytest.approx(seconds_of(2500))
        assert not event["whole"]  # what follows it has not happened yet
        assert [(e["kind"], e["short"]) for e in event["events"]] == [("fault", "FOLLOWING"), ("mode", "HOLDING")]
        assert "no trigger" in asked.look(0.1, trigger=error | {"joint": 2})["error"]
    finally:
        servo.close(unlink=True)


def test_a_frozen_picture_is_kept_whole_while_the_ring_goes_on_and_is_exported_with_every_number(asked: Asked) -> None:
    rows = make_rows(3000, N)
    servo = new_servo()
    try:
        append(servo, rows)
        live = asked.look(0.2)
        number = asked("keep", arm=ARM, begin=live["begin"], end=live["end"])["number"]
        append(servo, make_rows(2 * CAPACITY, N, first=3000))
        part = asked("kept", number=number, begin=live["begin"], end=seconds_of(2299), points=4000)
        np.testing.assert_array_equal(part["first"], quantities_of(rows[2199:2300]).astype("f4"))
        head, *lines = asked("csv", number=number, begin=seconds_of(2500), end=seconds_of(2502), joints=JOINTS).split()
        assert head.startswith("t_s,q_ref_waist,q_ref_lift,q_waist")
        assert len(lines) == 3
        told = [float(text) for text in lines[0].split(",")[1:-2]]
        np.testing.assert_array_equal(told, np.concatenate([rows[2500][name] for name in ("q_ref", "q", "v", "tau")]))
        for _ in range(MOST_KEPT):
            asked("keep", arm=ARM, begin=live["begin"], end=live["end"])
        assert "freeze again" in asked("kept", number=number, begin=0, end=1, points=2)["error"]
    finally:
        servo.close(unlink=True)


def test_of_a_servo_that_has_gone_the_last_cycles_stay_until_another_one_comes(asked: Asked) -> None:
    assert "qrobot up" in asked.look(0.1)["error"]
    servo = new_servo()
    assert "no cycle" in asked.look(0.1)["error"]
    append(servo, make_rows(100, N))
    assert asked.look(0.1)["cycles"] == 100
    servo.close(unlink=True)
    assert asked.look(0.1)["newest"] == 99
    servo = new_servo()
    append(servo, make_rows(40, N))
    assert asked.look(0.1)["cycles"] == 40
    servo.close(unlink=True)


def test_cycles_that_were_overwritten_leave_no_gap_in_what_is_kept() -> None:
    ring = Ring(capacity=1024)
    history = RingHistory(ring.reader(), keep=500)
    ring.append(make_rows(300))
    history.take()
    ring.append(make_rows(3000, first=300))
    history.take()
    ticks = history.since(0)["tick"]
    np.testing.assert_array_equal(ticks, np.arange(2800, 3300))
    for k in range(10):
        ring.append(make_rows(100, first=3300 + 100 * k))
        history.take()
    assert 500 <= history.since(0).size < 600
    assert CycleTrigger("position", 0, True, 2.0).first_in(history.since(0)) is None
