"""The way back to a stream after a lost frame: as fast as the stream and half as hard again, and back on it in time."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from qrobot.arrays import Floats
from qrobot.faultcodes import NO_JOINT
from qrobot.servo.kernels.interpolator import shift_extrapolated, shift_in
from qrobot.servo.kernels.lead_back import BEND_SLACK, PULL, lead_back, too_far_aside, turns_outside
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT, TORQUE_SETPOINT

T = 0.1
V_MAX, A_MAX = np.array([1.4]), np.array([12.0])
ANYWHERE = np.array([np.inf])
FRAMES = 30
ALLOWED = np.array([0.2])
POSITION = np.array([POSITION_SETPOINT])
TORQUE = np.array([TORQUE_SETPOINT])
# what to do with the speed in each frame, as a share of a_max: the extremes, and anything between
accelerations = st.lists(st.sampled_from([-1.0, 1.0]) | st.floats(-1.0, 1.0), min_size=FRAMES, max_size=FRAMES)


def legal_stream(shares: list[float]) -> Floats:
    """Setpoints of one joint within v_max and a_max, from rest, that stand still in the end."""
    velocity, step = [0.0], float(A_MAX[0]) * T
    for share in shares:
        velocity.append(float(np.clip(velocity[-1] + share * step, -V_MAX[0], V_MAX[0])))
    while velocity[-1] != 0.0:
        velocity.append(velocity[-1] - float(np.clip(velocity[-1], -step, step)))
    return np.cumsum([*velocity, *[0.0] * 40]) * T


def played(stream: Floats, lost: int, q_min: Floats = -ANYWHERE, q_max: Floats = ANYWHERE) -> Floats:
    """The knots that become of a stream of which one frame is lost; as many as it has setpoints."""
    knots, aside, bridged, taken = np.zeros((4, 1)), np.zeros(1), 0, []
    for seq, place in enumerate(stream):
        if seq == lost:
            shift_extrapolated(knots)
            bridged = 1
        else:
            setpoint = np.array([place])
            lead_back(setpoint, POSITION, knots, aside, bridged, q_min, q_max, V_MAX, A_MAX, T)
            shift_in(knots, setpoint)
            bridged = 2 if bridged == 1 else 0
        taken.append(knots[3, 0])
    return np.array(taken)


lost_frames = st.integers(2, FRAMES - 1)


@given(accelerations, lost_frames)
def test_whatever_frame_is_lost_no_step_exceeds_the_speed_and_no_bend_one_and_a_half_times_the_acceleration(
    shares: list[float], lost: int
) -> None:
    steps = np.diff(played(legal_stream(shares), lost))
    assert np.abs(steps).max() <= V_MAX[0] * T + 1e-9
    assert np.abs(np.diff(steps)).max() <= BEND_SLACK * A_MAX[0] * T**2 + 1e-9


@given(accelerations, lost_frames)
def test_no_bend_exceeds_that_of_the_stream_but_where_it_is_told_and_at_the_setpoint_behind(
    shares: list[float], lost: int
) -> None:
    """A stream may use all of a_max as soon as the path is back: the last part of the way back adds to its bend."""
    knots, aside, bridged, before = np.zeros((4, 1)), np.zeros(1), 0, False
    for seq, place in enumerate(legal_stream(shares)):
        if seq == lost:
            shift_extrapolated(knots)
            bridged = 1
            continue
        setpoint = np.array([place])
        led = lead_back(setpoint, POSITION, knots, aside, bridged, -ANYWHERE, ANYWHERE, V_MAX, A_MAX, T)
        bend = abs(setpoint[0] - 2.0 * knots[3, 0] + knots[2, 0])
        assert bend <= (BEND_SLACK if led or before else 1.0) * A_MAX[0] * T**2 + 1e-9
        shift_in(knots, setpoint)
        bridged, before = 2 if bridged == 1 else 0, led


def test_no_smaller_slack_would_do_for_a_turn_at_full_acceleration() -> None:
    stream = legal_stream([1.0] * 1 + [-1.0] * 2 + [0.0] * (FRAMES - 3))
    steps = np.diff(played(stream, lost=2))
    assert np.abs(np.diff(steps)).max() == pytest.approx(BEND_SLACK * A_MAX[0] * T**2)


@given(accelerations, lost_frames)
def test_the_path_runs_beside_its_setpoints_by_at_most_the_largest_bend_and_comes_back_to_them(
    shares: list[float], lost: int
) -> None:
    stream = legal_stream(shares)
    beside = np.abs(played(stream, lost) - stream)
    assert beside.max() <= BEND_SLACK * A_MAX[0] * T**2 + 1e-9
    assert np.all(np.diff(beside[lost + 2 :]) <= 1e-12)
    assert beside[-1] == 0.0


@given(accelerations)
def test_a_stream_without_a_loss_keeps_every_bit(shares: list[float]) -> None:
    stream = legal_stream(shares)
    assert np.array_equal(played(stream, lost=-1).view(np.int64), stream.view(np.int64))


@given(accelerations, lost_frames)
def test_nothing_is_led_out_of_the_range_of_the_stream(shares: list[float], lost: int) -> None:
    stream = legal_stream(shares)
    q_min, q_max = np.array([stream.min()]), np.array([stream.max()])
    knots = np.delete(played(stream, lost, q_min, q_max), lost)  # the one that stands for it is the servo's
    assert q_min[0] <= knots.min()
    assert knots.max() <= q_max[0]


@pytest.mark.parametrize("place", [np.nan, np.inf, -np.inf, 1.01])
def test_what_has_to_be_refused_is_left_as_it_is(place: float) -> None:
    setpoint, aside = np.array([place]), np.array([0.1])
    assert not lead_back(setpoint, POSITION, np.zeros((4, 1)), aside, 1, -V_MAX, np.ones(1), V_MAX, A_MAX, T)
    np.testing.assert_array_equal(setpoint, [place])


def test_a_torque_is_not_led_and_the_joint_begins_anew() -> None:
    torque, aside = np.array([7.0]), np.array([0.1])
    assert not lead_back(torque, TORQUE, np.ones((4, 1)), aside, 1, -ANYWHERE, ANYWHERE, V_MAX, A_MAX, T)
    assert (torque[0], aside[0]) == (7.0, 0.0)


@pytest.mark.parametrize("speed", [-1.0, 1.0])
def test_at_full_speed_the_path_waits_beside_its_setpoints_until_the_joint_is_slower(speed: float) -> None:
    knots = np.arange(4.0)[:, None] * speed * V_MAX * T
    aside = np.array([-0.05 * speed])  # behind: to come back it would have to be faster than it can
    for _ in range(5):
        setpoint = knots[3] + speed * V_MAX * T - aside
        assert lead_back(setpoint, POSITION, knots, aside, 0, -ANYWHERE, ANYWHERE, V_MAX, A_MAX, T)
        shift_in(knots, setpoint)
        assert aside[0] == pytest.approx(-0.05 * speed)
    setpoint = knots[3] - aside
    lead_back(setpoint, POSITION, knots, aside, 0, -ANYWHERE, ANYWHERE, V_MAX, A_MAX, T)
    assert aside[0] == pytest.approx(speed * (PULL * A_MAX[0] * T**2 - 0.05))


def test_the_frame_after_the_next_may_bend_more_than_its_stream_even_where_the_next_is_in_its_place() -> None:
    """Second differences of -0.5, 1 and 1 around a lost frame: none at the next, 1.5 at the one after it."""
    knots, aside = np.array([[0.0], [0.0], [0.0], [0.0]]), np.zeros(1)
    unit = A_MAX[0] * T**2
    bends = []
    for bridged, place in ((1, 0.0), (2, 1.5 * unit)):
        setpoint = np.array([place])
        assert lead_back(setpoint, POSITION, knots, aside, bridged, -ANYWHERE, ANYWHERE, V_MAX, A_MAX, T)
        bends.append(float(setpoint[0] - 2.0 * knots[3, 0] + knots[2, 0]))
        shift_in(knots, setpoint)
    assert bends == pytest.approx([0.0, BEND_SLACK * unit])


def test_a_motion_of_constant_velocity_comes_back_at_once() -> None:
    stream = np.concatenate([[0.0, 0.02], 0.02 + 0.1 * np.arange(1.0, 20.0)])
    for before, after in pairwise(played(stream, lost=9)[8:]):
        assert after - before == pytest.approx(0.1)


@given(accelerations, st.sets(lost_frames))
def test_of_any_losses_either_the_path_stays_within_what_one_may_do_or_no_way_leads_back(
    shares: list[float], lost: set[int]
) -> None:
    """As many losses as there may be without two in a row; a stop ends the stream."""
    stream = legal_stream(shares)
    knots, aside, bridged = np.zeros((4, 1)), np.zeros(1), 0
    for seq, place in enumerate(stream):
        if seq in lost and seq - 1 not in lost:
            shift_extrapolated(knots)
            bridged = 1
            continue
        setpoint = np.array([place])
        led = lead_back(setpoint, POSITION, knots, aside, bridged, -ANYWHERE, ANYWHERE, V_MAX, A_MAX, T)
        if led and too_far_aside(aside, ALLOWED, A_MAX, T) != NO_JOINT:
            return
        shift_in(knots, setpoint)
        bridged = 2 if bridged == 1 else 0
        assert abs(setpoint[0] - place) <= max(ALLOWED[0], BEND_SLACK * A_MAX[0] * T**2)
    assert aside[0] == 0.0


places = st.floats(-1.0, 1.0)


@given(places, places, places)
def test_a_path_that_turns_back_beyond_its_range_and_the_margin_is_found(
    before: float, newest: float, to: float
) -> None:
    """By the parabola through the three of them, from the newest to the next setpoint."""
    u = np.linspace(0.0, 1.0, 10_001)
    way = np.polyval(np.polyfit([-1.0, 0.0, 1.0], [before, newest, to], 2), u)
    q_min, q_max, margin = np.array([-0.5]), np.array([0.4]), np.array([0.1])
    beyond = max(way.max() - 0.5, -0.6 - way.min())
    assume(abs(beyond) > 1e-6)
    turns = 0 < int(way.argmax()) < u.size - 1 or 0 < int(way.argmin()) < u.size - 1
    knots, setpoint = np.array([[0.0], [0.0], [before], [newest]]), np.array([to])
    assume(turns or abs(0.5 * (to - before)) > abs(to - 2.0 * newest + before))  # else it turns at one of the ends
    found = turns_outside(setpoint, POSITION, knots, q_min, q_max, margin)
    inside = -0.6 <= min(newest, to) <= max(newest, to) <= 0.5  # what they say themselves is judged elsewhere
    assume(inside)
    assert found == (0 if turns and beyond > 0.0 else NO_JOINT)
    assert turns_outside(setpoint, TORQUE, knots, q_min, q_max, margin) == NO_JOINT
