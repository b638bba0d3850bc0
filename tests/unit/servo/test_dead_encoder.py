"""What makes a silent encoder a dead one: bounds of torque, distance that is sure, and the word of a potentiometer."""

from __future__ import annotations

import math

import pytest

from qrobot.servo.checks.dead_encoder import (
    BASE_SHARE,
    FAILED_TURNS,
    FIRST_READINGS,
    GONE_TURNS,
    LAG_S,
    SLID_COUNTS,
    SPREADS,
    TRIED_SHARE,
    TRIED_TURNS,
    WRONG_INERTIA,
    follow_pot,
    gone_units,
    has_followed,
    in_a_row,
    is_at_end,
    is_missing,
    lasting,
    predict_travel,
    shown_residue,
    sliding_torque,
    torque_bounds,
)
from qrobot.servo.kernels.velocity import REST

NAN, INF = math.nan, math.inf
HELD_UP, HELD_DOWN, RISE_UP, RISE_DOWN = 40.0, 30.0, 4.0, 3.0


def bounds(slid: float, travel: int, going: bool, inertial: float = 0.0, scale: float = 0.0) -> tuple[float, float]:
    return torque_bounds(slid, travel, going, HELD_UP, HELD_DOWN, RISE_UP, RISE_DOWN, inertial, scale)


@pytest.mark.parametrize(
    ("slid", "travel", "going", "expected"),
    [
        (10.0, SLID_COUNTS, True, (-30.0, 14.0)),
        (10.0, SLID_COUNTS - 1, True, (-30.0, 40.0)),
        (10.0, SLID_COUNTS, False, (-30.0, 40.0)),
        (39.0, SLID_COUNTS, True, (-30.0, 40.0)),
        (-20.0, SLID_COUNTS, True, (-30.0, -16.0)),
        (-10.0, -SLID_COUNTS, True, (-13.0, 40.0)),
        (-10.0, 1 - SLID_COUNTS, True, (-30.0, 40.0)),
        (-10.0, -SLID_COUNTS, False, (-30.0, 40.0)),
        (20.0, -SLID_COUNTS, True, (17.0, 40.0)),
        (0.0, 0, True, (-30.0, 40.0)),
    ],
)
def test_what_slid_has_measured_its_friction_and_only_the_way_it_went(
    slid: float, travel: int, going: bool, expected: tuple[float, float]
) -> None:
    assert bounds(slid, travel, going) == expected


@pytest.mark.parametrize("going", [False, True])
def test_other_joints_widen_every_bound_and_the_scale_of_torque_only_those_at_rest(going: bool) -> None:
    least, greatest = bounds(10.0, 99, going)
    assert bounds(10.0, 99, going, inertial=5.0) == (least - 5.0, greatest + 5.0)
    assert bounds(10.0, 99, going, scale=2.0) == (least - 2.0, greatest if going else greatest + 2.0)


def test_a_joint_that_must_move_goes_as_a_free_mass_under_what_exceeds_its_bound() -> None:
    v = x = 0.0
    dt, inertia, seconds = 1e-4, 4.0, 0.1
    for _ in range(round(seconds / dt)):
        v, x = predict_travel(50.0, -30.0, 40.0, inertia, dt, v, x)
    assert v == pytest.approx(10.0 / inertia * seconds)
    assert x == pytest.approx(0.5 * 10.0 / inertia * seconds**2, rel=2 * dt / seconds)


def test_downwards_it_is_the_same_and_within_the_bounds_nothing_is_sure_but_the_way() -> None:
    up, down = (
        predict_travel(42.0, -30.0, 40.0, 2.0, 0.5, 0.0, 0.0),
        predict_travel(-32.0, -30.0, 40.0, 2.0, 0.5, 0.0, 0.0),
    )
    assert up == (0.5, 0.25)
    assert down == (-0.5, -0.25)
    for torque in (40.0, -30.0, 0.0):
        assert predict_travel(torque, -30.0, 40.0, 2.0, 0.5, *up) == (0.0, 0.25)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_more_counts_than_the_limit_are_missing_and_so_is_what_is_no_number(sign: float) -> None:
    limit = 4.0 * 1e-4
    assert not is_missing(sign * limit, 4.0, 1e-4)
    assert is_missing(sign * math.nextafter(limit, INF), 4.0, 1e-4)
    assert is_missing(NAN, 4.0, 1e-4)


def test_a_peak_lasts_for_as_long_as_joints_take_to_follow() -> None:
    assert lasting(1.0, -3.0, 0.001) == 3.0
    assert lasting(1.0, 0.0, LAG_S / 4) == pytest.approx(0.75)
    assert lasting(1.0, 0.0, LAG_S) == lasting(1.0, 0.0, 9.0) == 0.0
    peak, dt = 1.0, LAG_S / 1000
    for _ in range(1000):
        peak = lasting(peak, 0.0, dt)
    assert peak == pytest.approx(math.exp(-1.0), rel=1e-3)
    for _ in range(30_000):
        peak = lasting(peak, 0.0, dt)
        assert peak == 0.0 or peak >= REST  # no denormal number, however long the arm holds
    assert peak == 0.0


@pytest.mark.parametrize("acceleration", [-8.0, -1.0, 0.0, 1.0, 8.0])
@pytest.mark.parametrize("inertia", [0.0, 1.0, 2.0])
def test_a_bend_leaves_room_for_an_inertia_up_to_twice_as_large(acceleration: float, inertia: float) -> None:
    """Friction of a sliding joint is its torque less M a: never more than what is allowed for, whatever M is."""
    torque = 20.0
    assert sliding_torque(torque, 1, 1.0, abs(acceleration)) >= torque - inertia * acceleration
    assert sliding_torque(torque, -1, 1.0, abs(acceleration)) <= torque - inertia * acceleration
    assert sliding_torque(torque, 1, 4.0, 2.0) == torque + WRONG_INERTIA * 8.0
    assert sliding_torque(torque, 0, 4.0, 2.0) == torque - WRONG_INERTIA * 8.0


TURN = 150.0


def test_a_potentiometer_begins_with_the_mean_of_its_first_readings() -> None:
    mean = before = 0.0
    for k, residue in enumerate((10.0, 20.0, 30.0, 40.0)):
        mean, trusted = follow_pot(residue, before, mean, k, False, TURN)
        before = residue
        assert trusted
    assert mean == pytest.approx(25.0)


def test_later_it_follows_only_what_is_free_to_go_together() -> None:
    assert follow_pot(40.0, 0.0, 0.0, FIRST_READINGS, True, TURN) == (40.0 * BASE_SHARE, True)
    assert follow_pot(50.0, 40.0, 10.0, FIRST_READINGS, True, TURN) == (10.0 + 40.0 * BASE_SHARE, True)
    assert follow_pot(40.0, 0.0, 0.0, FIRST_READINGS, False, TURN) == (0.0, True)


@pytest.mark.parametrize("step", [FAILED_TURNS * TURN, -FAILED_TURNS * TURN])
def test_a_step_that_no_motor_makes_is_a_potentiometer_that_has_failed(step: float) -> None:
    assert follow_pot(step, 0.0, 0.0, 9, True, TURN)[1]
    assert follow_pot(math.nextafter(step, math.copysign(INF, step)), 0.0, 7.0, 9, True, TURN) == (7.0, False)
    assert follow_pot(NAN, 0.0, 7.0, 9, True, TURN) == (7.0, False)
    assert follow_pot(-0.6 * TURN, 0.6 * TURN, 7.0, 9, True, TURN) == (7.0, False)
    assert follow_pot(80.0 - TURN, 80.0, 7.0, 9, False, TURN) == (7.0, True)


def test_where_a_potentiometer_is_found_first_is_no_step() -> None:
    assert follow_pot(9.0 * TURN, 0.0, 0.0, 0, True, TURN) == (9.0 * TURN, True)


TRACK = 16384.0


@pytest.mark.parametrize("residue", [-90.0, 0.0, 8000.0, TRACK + 90.0])
@pytest.mark.parametrize("units", [0.0, 1.0, 0.3 * TRACK, TRACK])
def test_on_its_track_a_potentiometer_shows_its_own_residue(residue: float, units: float) -> None:
    assert shown_residue(residue, units - residue, TRACK) == residue


@pytest.mark.parametrize("beyond", [1.0, 900.0])
def test_beyond_an_end_of_its_track_it_shows_that_end(beyond: float) -> None:
    for end, side in ((0.0, -1.0), (TRACK, 1.0)):
        counted = 5000.0
        assert shown_residue(end + side * beyond - counted, counted, TRACK) + counted == end


def test_near_an_end_of_its_track_the_motor_may_be_beyond_it() -> None:
    assert is_at_end(-20.0, 75.0, TRACK)
    assert is_at_end(74.0, 75.0, TRACK)
    assert not is_at_end(75.0, 75.0, TRACK)
    assert not is_at_end(TRACK - 75.0, 75.0, TRACK)
    assert is_at_end(TRACK - 74.0, 75.0, TRACK)
    assert is_at_end(TRACK, 75.0, TRACK)
    assert not is_at_end(NAN, 75.0, TRACK)


def test_a_motor_is_gone_by_a_quarter_of_a_turn_or_by_twice_what_an_unknown_potentiometer_strays_at_rest() -> None:
    assert gone_units(TURN, 0.0, 0.0) == GONE_TURNS * TURN
    assert gone_units(TURN, 0.5 * GONE_TURNS * TURN / SPREADS, 0.0) == GONE_TURNS * TURN
    assert gone_units(TURN, 40.0, 0.0) == SPREADS * 40.0
    assert gone_units(TURN, 40.0, 64.0) == SPREADS * 40.0 + 64.0


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_potentiometer_has_followed_when_it_missed_no_more_than_its_share_of_two_turns(
    way: float, side: float
) -> None:
    counts, allowed = way * TRIED_TURNS * 800.0, side * TRIED_SHARE * TRIED_TURNS * TURN
    assert has_followed(allowed, counts, 800.0, TURN) == 1
    assert has_followed(math.nextafter(allowed, side * INF), counts, 800.0, TURN) == -1
    assert has_followed(1.5 * allowed, 2.0 * counts, 800.0, TURN) == 1
    assert has_followed(9.0 * allowed, math.nextafter(counts, 0.0), 800.0, TURN) == 0
    assert has_followed(NAN, counts, 800.0, TURN) == -1


@pytest.mark.parametrize("side", [1, -1])
def test_readings_in_a_row_are_those_to_one_side(side: int) -> None:
    off = math.nextafter(20.0, INF) * side
    assert in_a_row(0, off, 20.0) == side
    assert in_a_row(3 * side, off, 20.0) == 4 * side
    assert in_a_row(-3 * side, off, 20.0) == side
    assert in_a_row(3 * side, 20.0 * side, 20.0) == 0
    assert in_a_row(3 * side, 0.0, 20.0) == 0
    assert in_a_row(3 * side, NAN, 20.0) == 0
