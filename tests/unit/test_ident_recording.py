"""Recordings that would mislead a fit: what is wrong is named with joint and time, and what is right is let pass."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.errors import IdentificationError
from qrobot.ident.load import LoadChange, load_change
from qrobot.ident.model import identify
from qrobot.ident.recording import check_recording
from qrobot.servo.modes import Mode
from qrobot.servo.telemetry import Rows, TelemetryLayout
from tests.support.observations import drawn, generated, puma_base

PUMA = load_robot("puma560")
N, ELBOW = PUMA.n, 2
PERIOD_S = 0.001
COUNTS = 1.0 / PUMA.transmission.rad_per_count


def swinging(seconds: float = 4.0) -> Rows:
    """All joints swing by 0.3 rad, and the counters with them."""
    rows = TelemetryLayout(N).empty(round(seconds / PERIOD_S))
    t = PERIOD_S * np.arange(len(rows))
    rows["tick"], rows["mode"], rows["dac"] = np.arange(len(rows)), Mode.TRACKING, 2048
    rows["q_ref"] = PUMA.poses["ready"] + 0.3 * np.sin(2.0 * t)[:, None]
    rows["counts"] = np.rint(rows["q_ref"] @ PUMA.transmission.coupling.T * COUNTS)
    return rows


def complaint(rows: Rows) -> str:
    with pytest.raises(IdentificationError) as caught:
        check_recording(PUMA, rows, PERIOD_S)
    return str(caught.value)


def test_a_sound_recording_is_let_pass() -> None:
    check_recording(PUMA, swinging(), PERIOD_S)
    check_recording(PUMA, swinging(0.0), PERIOD_S)


def test_an_encoder_that_stands_still_is_named_with_its_time() -> None:
    rows = swinging()
    rows["counts"][1500:2500, ELBOW] = rows["counts"][1500, ELBOW]
    assert "the encoder of elbow stands still from 1.5 to 2.5 s" in complaint(rows)


def test_a_joint_that_sticks_for_a_moment_is_no_broken_encoder() -> None:
    rows = swinging()
    reversal = slice(740, 830)  # a quarter period: the joint turns round, and friction holds it
    rows["counts"][reversal, ELBOW] = rows["counts"][reversal.start, ELBOW]
    check_recording(PUMA, rows, PERIOD_S)


def test_an_arm_at_rest_has_no_broken_encoders() -> None:
    rows = swinging()
    rows["mode"], rows["counts"] = Mode.HOLDING, 0
    check_recording(PUMA, rows, PERIOD_S)


def with_flag(rows: Rows) -> None:
    rows["flags"][2000:2500] = 1 << 8 + ELBOW


def with_dac(rows: Rows, word: int) -> None:
    rows["dac"][2000:2500, ELBOW] = word


@pytest.mark.parametrize("spoil", [with_flag, partial(with_dac, word=4095), partial(with_dac, word=0)])
def test_a_torque_at_its_limit_is_named(spoil: Callable[[Rows], None]) -> None:
    rows = swinging()
    spoil(rows)
    said = complaint(rows)
    assert "the torque of elbow was at its limit for 0.5 s, first at 2.0 s" in said
    assert "shoulder" not in said


def test_a_moment_at_the_limit_is_only_left_out() -> None:
    rows = swinging()
    rows["dac"][2000:2010, ELBOW] = 4095
    check_recording(PUMA, rows, PERIOD_S)


def carried(load_kg: np.ndarray, noise: float = 0.05) -> tuple[LoadChange | None, float]:
    """What a recording shows of a change, and when pose 18 of 30 begins."""
    beta, friction = drawn(7, load_kg=0.0)
    observations = generated(beta, friction, noise, 7, load_kg=load_kg)
    found = identify(PUMA, *reversed(puma_base()), observations)
    return load_change(found), float(observations.time_s[18 * 4 * N])


@pytest.mark.parametrize("dropped_kg", [0.3, 1.5])
def test_a_load_that_is_dropped_half_way_is_named_with_its_time(dropped_kg: float) -> None:
    change, when = carried(np.where(np.arange(30) < 18, dropped_kg, 0.0))
    assert change is not None
    assert change.kg == pytest.approx(-dropped_kg, rel=0.15)
    assert change.time_s == pytest.approx(when)


@pytest.mark.parametrize(("load_kg", "noise"), [(0.0, 0.05), (2.0, 0.05), (0.0, 0.5), (1.0, 0.0)])
def test_a_load_that_stays_is_no_change(load_kg: float, noise: float) -> None:
    assert carried(np.full(30, load_kg), noise)[0] is None
