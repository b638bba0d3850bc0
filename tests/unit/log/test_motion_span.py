"""Logs cut around their motion: what waited before it does not shift one figure against the other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from qrobot.log.motion_span import BESIDE_S, around_motion
from qrobot.log.read import Log
from qrobot.modecodes import Mode
from qrobot.servo.memory.telemetry import TelemetryLayout
from tests.support.log_samples import make_header

PERIOD_NS = 10_000_000
MOTION_S = 2.0


def log_of(waited_s: float, after_s: float = 5.0, speed: float = 0.5) -> Log:
    """An arm that is held, moves joint 2 for two seconds and is held again."""
    begin, end = (round(seconds * 1e9 / PERIOD_NS) for seconds in (waited_s, waited_s + MOTION_S))
    rows = TelemetryLayout(3).empty(end + round(after_s * 1e9 / PERIOD_NS))
    rows["t_ns"] = 7_000_000_000 + np.arange(rows.size) * PERIOD_NS
    rows["mode"] = Mode.HOLDING
    rows["mode"][begin:] = Mode.TRACKING
    rows["v_ref"][begin:end, 1] = speed
    return Log(Path("run.mcap"), make_header(3, PERIOD_NS), rows)


def first_motion_s(log: Log) -> float:
    return float(log.time_s[np.flatnonzero(log.rows["v_ref"].any(axis=1))[0]])


@pytest.mark.parametrize(("waits", "lead_s"), [((13.0, 1.5), BESIDE_S), ((13.0, 0.25), 0.25), ((0.0, 3.0), 0.0)])
def test_the_first_motions_of_two_runs_have_one_time(waits: tuple[float, float], lead_s: float) -> None:
    shown = around_motion([log_of(wait) for wait in waits])
    assert [first_motion_s(log) for log in shown] == pytest.approx([lead_s] * 2, abs=1e-9)
    assert [log.time_s[-1] for log in shown] == pytest.approx([lead_s + MOTION_S + BESIDE_S] * 2, abs=0.02)


def test_a_log_that_ends_with_its_motion_and_one_without_any_are_shown_to_their_ends() -> None:
    ends, rests = log_of(4.0, after_s=0.0), log_of(4.0, speed=1e-4)
    shown_ends, shown_rests = around_motion([ends, rests])
    assert shown_ends.rows[-1] == ends.rows[-1]
    assert shown_rests is rests


def test_what_moves_without_being_led_is_no_motion() -> None:
    log = log_of(4.0)
    log.rows["v_ref"][:100] = 0.2  # the reference of an arm that sinks follows it
    assert first_motion_s(around_motion([log])[0]) == pytest.approx(BESIDE_S)
