"""Which rows of a table a run of index pulses is: certain, or refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.config import load_robot
from qrobot.faultcodes import FaultCode
from qrobot.servo.calibration.index_matching import find_rows, in_table, misfit, nearest_row, pot_step
from qrobot.servo.calibration.state import DEFAULT_INDEXES
from qrobot.servo.calibration.table import calibration_params, load_table

ROBOT = load_robot("puma560")
TABLE = calibration_params(ROBOT.n, load_table("puma560", ROBOT))
JOINTS = st.integers(0, ROBOT.n - 1)
N = DEFAULT_INDEXES


def readings(joint: int, row: int, n: int = N) -> np.ndarray:
    return TABLE.pot[joint, row : row + n].copy()


@given(JOINTS, st.sampled_from([3, 5, 14]), st.data())
def test_every_run_of_rows_is_found_with_everybodys_vote(joint: int, n: int, data: st.DataObject) -> None:
    row = data.draw(st.integers(0, int(TABLE.rows[joint]) - n))
    code, found, off, margin, votes = find_rows(TABLE, joint, readings(joint, row, n), n)
    assert (code, found, off, votes) == (0, row, 0.0, n)
    assert margin > 0.6 * pot_step(TABLE, joint)


@given(JOINTS, st.data(), st.lists(st.floats(-40.0, 40.0), min_size=N, max_size=N))
def test_waviness_noise_and_backlash_of_a_pot_do_not_change_the_place(
    joint: int, data: st.DataObject, noise: list[float]
) -> None:
    row = data.draw(st.integers(0, int(TABLE.rows[joint]) - N))
    code, found, *_ = find_rows(TABLE, joint, readings(joint, row) + noise, N)
    assert code == 0
    assert found == row


@given(JOINTS, st.data(), st.lists(st.floats(-1000.0, 1000.0), min_size=N, max_size=N))
def test_whatever_the_readings_a_place_taken_fits_alone_and_has_a_majority(
    joint: int, data: st.DataObject, noise: list[float]
) -> None:
    row = data.draw(st.integers(0, int(TABLE.rows[joint]) - N))
    pots = readings(joint, row) + noise
    code, found, off, margin, votes = find_rows(TABLE, joint, pots, N)
    if code == 0:
        distances = [misfit(TABLE, joint, pots, N, first) for first in range(int(TABLE.rows[joint]) - N + 1)]
        assert found == int(np.argmin(distances))
        assert off == min(distances) <= 0.4 * pot_step(TABLE, joint)
        assert margin == pytest.approx(sorted(distances)[1] - min(distances))
        assert 2 * votes > N


def test_one_reading_gone_wrong_is_outvoted() -> None:
    pots = readings(1, 20)
    pots[2] += 200.0
    code, found, *_, votes = find_rows(TABLE, 1, pots, N)
    assert (code, found, votes) == (0, 20, N - 1)


def test_a_dead_potentiometer_finds_no_majority() -> None:
    dead = np.full(N, TABLE.pot[0, 25])
    assert find_rows(TABLE, 0, dead, N)[0] == FaultCode.CAL_VOTE


def test_readings_half_way_between_two_places_are_refused() -> None:
    half = 0.5 * (readings(2, 10) + readings(2, 11))
    assert find_rows(TABLE, 2, half, N)[0] == FaultCode.CAL_VOTE


@pytest.mark.parametrize("wrong", [-30_000.0, 30_000.0, np.nan, np.inf])
def test_a_reading_that_is_none_of_the_table_is_a_mismatch(wrong: float) -> None:
    pots = readings(3, 10)
    pots[1] = wrong
    assert find_rows(TABLE, 3, pots, N)[0] == FaultCode.CAL_MISMATCH
    assert not in_table(TABLE, 3, wrong, 1)


def test_the_nearest_row_is_the_one_whose_reading_is() -> None:
    assert nearest_row(TABLE, 5, TABLE.pot[5, 33] + 0.4 * pot_step(TABLE, 5)) in (32, 33, 34)
    assert nearest_row(TABLE, 5, TABLE.pot[5, 33]) == 33
