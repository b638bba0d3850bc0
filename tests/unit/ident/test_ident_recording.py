"""Recordings that would mislead a fit: what is wrong is named with joint and time, and what is right is let pass."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.errors import IdentificationError
from qrobot.ident.change import LoadChange, counter_slip, load_change
from qrobot.ident.exchanged import check_torques
from qrobot.ident.model import Identified, identify
from qrobot.ident.recording import check_recording
from qrobot.modecodes import Mode
from qrobot.model.transmission import transmission_params
from qrobot.servo.memory.telemetry import Rows, TelemetryLayout
from tests.support.observations import drawn, generated, puma_base

PUMA = load_robot("puma560")
N, ELBOW = PUMA.n, 2
PERIOD_S = 0.001


def swinging(seconds: float = 4.0) -> Rows:
    """All joints swing by 0.3 rad, and the counters with them."""
    rows = TelemetryLayout(N).empty(round(seconds / PERIOD_S))
    t = PERIOD_S * np.arange(len(rows))
    rows["tick"], rows["mode"], rows["dac"] = np.arange(len(rows)), Mode.TRACKING, 2048
    rows["q_ref"] = PUMA.poses["ready"] + 0.3 * np.sin(2.0 * t)[:, None]
    params = transmission_params(PUMA)
    rows["counts"] = np.rint((rows["q_ref"] - params.q_offset) @ params.count_per_joint.T) + params.count_offset
    return measured(rows)


def measured(rows: Rows) -> Rows:
    """The rows with the positions that a servo computes from their counters."""
    params = transmission_params(PUMA)
    rows["q"] = params.q_offset + (rows["counts"] - params.count_offset) @ params.joint_per_count.T
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
    measured(rows)
    assert "the encoder of elbow stands still from 1.5 to 2.5 s" in complaint(rows)


def test_a_joint_that_sticks_for_a_moment_is_no_broken_encoder() -> None:
    rows = swinging()
    reversal = slice(740, 830)  # a quarter period: the joint turns round, and friction holds it
    rows["counts"][reversal, ELBOW] = rows["counts"][reversal.start, ELBOW]
    measured(rows)
    check_recording(PUMA, rows, PERIOD_S)


def test_an_encoder_that_toggles_between_two_counts_stands_still_too() -> None:
    rows = swinging()
    rows["counts"][1500:2500, ELBOW] = rows["counts"][1500, ELBOW] + np.arange(1000) % 2
    assert "the encoder of elbow stands still from 1.5 to 2.5 s" in complaint(measured(rows))


@pytest.mark.parametrize("speed", [0.02, 0.1, 1.0])
def test_an_encoder_that_stands_still_is_found_at_any_speed(speed: float) -> None:
    rows = swinging()
    rows["q_ref"][:, ELBOW] = PUMA.poses["ready"][ELBOW] + speed * PERIOD_S * np.arange(len(rows))
    params = transmission_params(PUMA)
    rows["counts"] = np.rint((rows["q_ref"] - params.q_offset) @ params.count_per_joint.T) + params.count_offset
    check_recording(PUMA, measured(rows), PERIOD_S)
    rows["counts"][500:, ELBOW] = rows["counts"][500, ELBOW] + np.arange(len(rows) - 500) % 3
    assert "the encoder of elbow stands still from" in complaint(measured(rows))


def test_a_counter_that_slips_is_named_with_its_time_and_how_far() -> None:
    rows = swinging()
    rows["counts"][1500:, ELBOW] += 500
    said = complaint(measured(rows))
    assert re.search(r"the counter of elbow jumps by \+(49|50)\d at 1\.5 s", said)
    assert "waist" not in said


def test_a_counter_that_is_off_behind_a_gap_in_the_log_is_told_by_where_the_arm_was_to_be() -> None:
    rows = swinging()
    rows["counts"][1500:, ELBOW] += 700
    rows["tick"][1500:] += 3000
    assert "elbow is 0.08" in complaint(measured(rows))


@pytest.mark.parametrize("field", ["q", "q_ref", "v_ref", "tau"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_no_number_is_told_as_such(field: str, value: float) -> None:
    rows = swinging()
    rows[field][1000:1003, ELBOW] = value
    said = complaint(rows)
    assert f"({field}) of elbow is not a finite number in 3 of 4000 rows, first at 1.0 s" in said
    assert "robot file" not in said


@pytest.mark.parametrize(
    ("fields", "what"), [(["q"], "positions"), (["counts"], "counters"), (["counts", "q"], "count")]
)
def test_columns_of_two_joints_that_were_exchanged_are_named(fields: list[str], what: str) -> None:
    rows, order = swinging(), [0, 2, 1, 3, 4, 5]
    for field in fields:
        rows[field] = rows[field][:, order]
    said = complaint(rows)
    assert f"the {what}" in said
    assert "of shoulder follow what elbow was to do, and the reverse" in said


def test_positions_of_another_robot_file_are_not_those_of_the_counters() -> None:
    rows = swinging()
    rows["counts"][:, ELBOW] //= 2
    assert "the position of elbow is not that of its counters in 100 % of the rows" in complaint(rows)


def test_lost_rows_are_told_as_such_and_a_hiccup_or_another_log_is_none() -> None:
    rows = swinging()
    few = np.delete(rows, np.random.default_rng(1).choice(len(rows), 400, replace=False))
    assert re.search(r"(39\d|400) of \d+ cycles under way are missing at \d+ places", complaint(few))
    check_recording(PUMA, np.delete(rows, slice(1000, 1500)), PERIOD_S)
    other = swinging()
    other["tick"] += 100_000
    check_recording(PUMA, np.concatenate([rows, other]), PERIOD_S)
    check_recording(PUMA, np.concatenate([other, rows]), PERIOD_S)


def test_rows_that_are_not_as_far_apart_as_their_header_says_are_told() -> None:
    rows = swinging()
    rows["t_ns"] = 1_000_000 * np.arange(len(rows))
    check_recording(PUMA, rows, PERIOD_S)
    with pytest.raises(IdentificationError, match="rows are 1 ms apart and not 2"):
        check_recording(PUMA, rows, 2.0 * PERIOD_S)


def test_an_arm_at_rest_has_no_broken_encoders() -> None:
    rows = swinging()
    rows["mode"], rows["counts"] = Mode.HOLDING, 0
    check_recording(PUMA, rows, PERIOD_S)


def with_flag(rows: Rows) -> None:
    rows["flags"][2000:2500] = 1 << 8  # one joint, whichever
    rows["tau"][2000:2500, ELBOW] = -PUMA.guard.tau_max[ELBOW]


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


def slipped(counts: int, motor: int, from_pose: int = 18) -> Identified:
    """An arm whose counter of one motor is off from a pose on; it goes where the counter says."""
    regressor, base = puma_base()
    beta, friction = drawn(7)
    seen = generated(beta, friction, 0.01, 7)
    off = counts * PUMA.transmission.rad_per_count[motor] * np.linalg.inv(PUMA.transmission.coupling)[:, motor]
    q = seen.q - off * (seen.passed >= 4 * from_pose)[:, None]
    weight = np.linalg.inv(PUMA.transmission.coupling.T) @ base.columns(regressor(q)) @ beta
    change = weight[np.arange(len(seen)), seen.motor] - seen.gravity @ beta
    return identify(PUMA, base, regressor, replace(seen, torque=seen.torque + change))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("motor", [1, 2, 4])
@pytest.mark.parametrize("counts", [500, -500])
def test_a_counter_that_slipped_unseen_is_told_by_gravity(counts: int, motor: int) -> None:
    slip = counter_slip(slipped(counts, motor))
    assert slip is not None
    assert slip.motor == motor
    assert abs(slip.passed - 72) <= 5  # a pose has four passes
    assert slip.counts == pytest.approx(counts, rel=0.2)


@pytest.mark.parametrize("load_kg", [0.0, 0.5])
def test_neither_a_sound_counter_nor_a_load_that_goes_is_a_slip(load_kg: float) -> None:
    beta, friction = drawn(7, load_kg=0.0)
    observations = generated(beta, friction, 0.05, 7, load_kg=np.where(np.arange(30) < 18, load_kg, 0.0))
    assert counter_slip(identify(PUMA, *reversed(puma_base()), observations)) is None


def test_torques_of_two_motors_that_were_exchanged_are_named() -> None:
    beta, friction = drawn(7)
    seen = generated(beta, friction, 0.05, 7)
    check_torques(PUMA, seen)
    by_pass = seen.torque.reshape(-1, N)[:, [0, 2, 1, 3, 4, 5]]
    with pytest.raises(IdentificationError, match="the torque of shoulder is what elbow needs, and the reverse"):
        check_torques(PUMA, replace(seen, torque=by_pass.ravel()))
