"""Cycles without an image: what was carried on in them is no measurement, and no fault of a recording."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.errors import IdentificationError
from qrobot.ident.dropouts import LONGEST_S, long_dropout, measured_positions
from qrobot.ident.excitation import RUN_S
from qrobot.ident.motion import observe_motion
from qrobot.ident.observe import Observations, Observer, steady_passes
from qrobot.ident.recording import check_recording
from qrobot.modecodes import Mode
from qrobot.model.transmission import transmission_params
from qrobot.servo.memory.telemetry import FLAG_UNSEEN, Rows, TelemetryLayout
from tests.support.observations import puma_base

PUMA = load_robot("puma560")
PERIOD_S = 0.001
LAG = 2e-3  # rad


def turning(seconds: float = 4.0, share: float = 0.1) -> Rows:
    """All joints turn at a share of their greatest speed behind their references, forwards and back."""
    rows, params = TelemetryLayout(PUMA.n).empty(round(seconds / PERIOD_S)), transmission_params(PUMA)
    rows["tick"], rows["mode"], rows["dac"] = np.arange(len(rows)), Mode.TRACKING, 2048
    back = np.arange(len(rows)) >= len(rows) // 2
    rows["v_ref"] = np.where(back[:, None], -1.0, 1.0) * share * PUMA.limits.v_max
    rows["q_ref"] = PUMA.poses["ready"] + PERIOD_S * np.cumsum(rows["v_ref"], axis=0)
    q = rows["q_ref"] - LAG
    rows["counts"] = np.rint((q - params.q_offset) @ params.count_per_joint.T) + params.count_offset
    rows["q"] = params.q_offset + (rows["counts"] - params.count_offset) @ params.joint_per_count.T
    return rows


def without_images(rows: Rows, first: int, many: int, lag: float = LAG) -> Rows:
    """The same with some cycles in which no image came: counts stand, positions are behind their references."""
    rows, dark = rows.copy(), slice(first, first + many)
    rows["counts"][dark] = rows["counts"][first - 1]
    rows["q"][dark] = rows["q_ref"][dark] - lag
    rows["flags"][dark] |= FLAG_UNSEEN
    return rows


@pytest.mark.parametrize("many", [1, 3, 20])
def test_positions_that_were_carried_on_are_no_fault_of_counters(many: int) -> None:
    check_recording(PUMA, without_images(turning(share=1.0), 1000, many), PERIOD_S)


def test_every_other_cycle_without_an_image_is_no_fault_either() -> None:
    rows = turning(share=1.0)
    for first in range(1, len(rows), 2):
        rows = without_images(rows, first, 1) if first < 200 else rows
    check_recording(PUMA, rows, PERIOD_S)


def test_the_same_in_cycles_with_an_image_is_refused() -> None:
    rows = without_images(turning(share=0.5), 1000, 3)
    rows["flags"] = 0
    with pytest.raises(IdentificationError, match="the position of waist is not that of its counters"):
        check_recording(PUMA, rows, PERIOD_S)


@pytest.mark.parametrize("many", [1, 20])
def test_a_counter_that_slips_meanwhile_is_named_all_the_same(many: int) -> None:
    rows, params = without_images(turning(share=0.1), 1000, many), transmission_params(PUMA)
    rows["counts"][1000 + many :, 2] += 1000
    seen = np.arange(len(rows)) >= 1000 + many
    rows["q"][seen] = params.q_offset + (rows["counts"][seen] - params.count_offset) @ params.joint_per_count.T
    with pytest.raises(IdentificationError, match=r"the counter of elbow jumps by .* at 1\.0 s"):
        check_recording(PUMA, rows, PERIOD_S)


def test_positions_without_an_image_are_those_between_the_images() -> None:
    rows = turning()
    few = without_images(rows, 1000, 5, lag=0.1)
    np.testing.assert_allclose(measured_positions(few), rows["q"], atol=2e-4)  # counts
    np.testing.assert_array_equal(measured_positions(rows), rows["q"])
    assert not long_dropout(few, PERIOD_S).any()


def test_a_pass_ends_where_images_fail_for_long() -> None:
    many = round(LONGEST_S / PERIOD_S)
    rows = without_images(turning(), 1000, many)
    assert np.flatnonzero(long_dropout(rows, PERIOD_S)).tolist() == list(range(1000, 1000 + many))
    assert all(p.stop <= 1000 or p.start > 1000 + many for p in steady_passes(rows, PERIOD_S))
    assert not long_dropout(without_images(turning(), 1000, many - 1), PERIOD_S).any()
    ends = without_images(without_images(turning(), 1, 1), len(rows) - 3, 3)
    ends["flags"][0] |= FLAG_UNSEEN
    assert np.flatnonzero(long_dropout(ends, PERIOD_S)).tolist() == [0, 1, *range(len(rows) - 3, len(rows))]


def observed(rows: Rows) -> Observations:
    return Observer(PUMA, *puma_base()).observe(rows, PERIOD_S)


def test_what_was_carried_on_does_not_enter_an_observation() -> None:
    rows = turning()
    expected, seen = observed(rows), observed(without_images(rows, 1000, 5, lag=0.1))
    np.testing.assert_array_equal(seen.passed, expected.passed)
    np.testing.assert_allclose(seen.rate, expected.rate, atol=1e-5)
    np.testing.assert_allclose(seen.q, expected.q, atol=1e-5)


def test_what_was_carried_on_does_not_enter_an_equation_of_motion() -> None:
    rows = turning(2.0 * RUN_S)
    expected = observe_motion(PUMA, *puma_base(), rows, PERIOD_S)
    seen = observe_motion(PUMA, *puma_base(), without_images(rows, 1000, 5, lag=0.1), PERIOD_S)
    np.testing.assert_allclose(seen.rate, expected.rate, atol=1e-3)
    gone = observe_motion(PUMA, *puma_base(), without_images(rows, 1000, 20), PERIOD_S)
    assert len(expected) - len(gone) in (PUMA.n, 2 * PUMA.n)
