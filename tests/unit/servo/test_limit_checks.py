"""The safety gate, at and around every boundary, with NaN and infinities everywhere."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.faultcodes import NO_JOINT, FaultCode
from qrobot.servo.checks.limit_checks import (
    check_first_setpoint,
    check_following,
    check_image,
    check_range,
    check_setpoint,
    check_velocity,
    limit_torque,
)
from qrobot.servo.modes import StopCategory
from qrobot.servo.stop_categories import category_of, stop_category

NAN, INF = math.nan, math.inf
WELL = (FaultCode.NONE, NO_JOINT)
any_float = st.floats(allow_nan=True, allow_infinity=True)


def just_above(x: float) -> float:
    return math.nextafter(x, INF)


def just_below(x: float) -> float:
    return math.nextafter(x, -INF)


LIMITS = np.array([1.0, 2.0])


@pytest.mark.parametrize(
    ("v", "expected"),
    [
        ([0.0, 0.0], WELL),
        ([1.25, -2.5], WELL),
        ([just_above(1.25), 0.0], (FaultCode.VEL_LIMIT, 0)),
        ([0.0, -just_above(2.5)], (FaultCode.VEL_LIMIT, 1)),
        ([1.5, 0.0], (FaultCode.VEL_LIMIT, 0)),
        ([just_above(1.5), 0.0], (FaultCode.RUNAWAY, 0)),
        ([0.0, -just_above(3.0)], (FaultCode.RUNAWAY, 1)),
        ([0.0, NAN], (FaultCode.RUNAWAY, 1)),
        ([INF, 0.0], (FaultCode.RUNAWAY, 0)),
        ([1.3, 9.0], (FaultCode.RUNAWAY, 1)),  # the worse one, not the first
        ([9.0, 2.6], (FaultCode.RUNAWAY, 0)),
        ([1.3, NAN], (FaultCode.RUNAWAY, 1)),
        ([1.3, 2.6], (FaultCode.VEL_LIMIT, 0)),
    ],
)
def test_velocity_is_stopped_above_the_factor_and_cut_above_half_as_much_again(
    v: list[float], expected: tuple[int, int]
) -> None:
    assert check_velocity(np.array(v), LIMITS, 1.25) == expected


@pytest.mark.parametrize(
    ("q", "expected"),
    [
        ([0.0, 0.0], WELL),
        ([0.5, -0.25], WELL),
        ([just_above(0.5), 0.0], (FaultCode.FOLLOWING, 0)),
        ([0.0, just_below(-0.25)], (FaultCode.FOLLOWING, 1)),
        ([NAN, 0.0], (FaultCode.FOLLOWING, 0)),
    ],
)
def test_following_error_is_allowed_up_to_its_limit(q: list[float], expected: tuple[int, int]) -> None:
    allowed = np.array([0.5, 0.25])
    assert check_following(np.zeros(2), np.array(q), allowed) == expected
    reference = np.array([4.0, -2.0])
    assert check_following(reference, reference, allowed) == WELL
    assert check_following(reference, -reference, allowed) == (FaultCode.FOLLOWING, 0)


@pytest.mark.parametrize(
    ("q", "expected"),
    [
        ([-1.125, 2.125], WELL),
        ([just_below(-1.125), 0.0], (FaultCode.JOINT_LIMIT, 0)),
        ([1.125, 0.0], WELL),
        ([just_above(1.125), 0.0], (FaultCode.JOINT_LIMIT, 0)),
        ([0.0, just_above(2.125)], (FaultCode.JOINT_LIMIT, 1)),
        ([0.0, NAN], (FaultCode.JOINT_LIMIT, 1)),
    ],
)
def test_a_joint_may_be_in_its_range_and_the_margin_but_not_beyond(q: list[float], expected: tuple[int, int]) -> None:
    assert check_range(np.array(q), -LIMITS, LIMITS, np.full(2, 0.125)) == expected


@pytest.mark.parametrize(
    ("unchanged", "count", "status", "expected"),
    [
        (0, 1, 0, FaultCode.NONE),
        (20, 1, 0x8041, FaultCode.NONE),
        (21, 1, 0, FaultCode.BOARD_GONE),
        (0, 0, 0, FaultCode.BOARD_GONE),
        (0, 5, 0xFFFF, FaultCode.BOARD_GONE),
        (0, 5, 0xFFFE, FaultCode.NONE),
    ],
)
def test_an_image_must_be_published_renewed_and_not_all_ones(
    unchanged: int, count: int, status: int, expected: int
) -> None:
    assert check_image(unchanged, 20, count, status) == expected


@given(st.lists(any_float, min_size=3, max_size=3))
def test_no_torque_leaves_the_gate_that_is_not_finite_and_within_limits(tau: list[float]) -> None:
    limits = np.array([1.0, 10.0, 100.0])
    limited = np.array(tau)
    code, joint, clipped = limit_torque(limited, limits)
    assert np.all(np.abs(limited) <= limits)
    unchanged = [x for x, limit in zip(tau, limits, strict=True) if abs(x) <= limit]
    assert clipped == 3 - len(unchanged)
    if not all(math.isfinite(x) for x in tau):
        assert code == FaultCode.LAW_NAN
        assert not math.isfinite(tau[joint])
        assert all(limited[j] == 0.0 for j in range(3) if not math.isfinite(tau[j]))
    else:
        assert code == FaultCode.NONE
        np.testing.assert_array_equal(limited, np.clip(tau, -limits, limits))


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_torque_exactly_at_the_limit_passes_untouched(sign: float) -> None:
    tau = np.array([sign * 5.0])
    assert limit_torque(tau, np.array([5.0])) == (FaultCode.NONE, NO_JOINT, 0)
    tau[0] = sign * just_above(5.0)
    assert limit_torque(tau, np.array([5.0])) == (FaultCode.NONE, NO_JOINT, 1)
    assert tau[0] == sign * 5.0


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_weak_joint_is_limited_in_its_own_direction(sign: float) -> None:
    tau = np.array([sign * 0.75])
    assert limit_torque(tau, np.array([0.5])) == (FaultCode.NONE, NO_JOINT, 1)
    assert tau[0] == sign * 0.5


def test_a_stream_has_to_begin_where_the_reference_stands() -> None:
    here = np.zeros(2)
    position, torque = np.array([1, 1]), np.array([1, 2])
    assert check_first_setpoint(np.array([0.02, -0.02]), position, here, 0.02) == WELL
    assert check_first_setpoint(np.array([0.0, just_above(0.02)]), position, here, 0.02) == (FaultCode.START_POSE, 1)
    assert check_first_setpoint(np.array([NAN, 0.0]), position, here, 0.02) == (FaultCode.START_POSE, 0)
    assert check_first_setpoint(np.array([0.0, 9.0]), torque, here, 0.02) == WELL
    elsewhere = np.array([1.0, -1.0])
    assert check_first_setpoint(elsewhere, position, elsewhere, 0.02) == WELL
    assert check_first_setpoint(-elsewhere, position, elsewhere, 0.02) == (FaultCode.START_POSE, 0)


@pytest.mark.parametrize("mode", [3, -1, 2**63 - 1, -(2**63)])
def test_a_mode_that_there_is_not_is_refused_at_the_first_setpoint_and_later(mode: int) -> None:
    """Nobody vouches for the words of the queue: the wire refuses such a mode before it gets there."""
    here, modes = np.zeros(2), np.array([0, mode])
    assert check_first_setpoint(here, modes, here, 0.02) == (FaultCode.SP_INVALID, 1)
    for value in (0.0, 0.25, 1e9, NAN):
        assert setpoint_verdict(value, mode=mode) == FaultCode.SP_INVALID


def setpoint_verdict(value: float, mode: int = 1, before: float = 0.0, at: float = 0.0, slack: float = 1.0) -> int:
    knots = np.array([[0.0], [0.0], [before], [at]])
    one = np.ones(1)
    code, joint = check_setpoint(
        np.array([value]), np.array([mode]), knots, -one, one, 4 * one, 16 * one, 8 * one, 0.125, slack
    )
    assert joint == (NO_JOINT if code == FaultCode.NONE else 0)
    return code


@pytest.mark.parametrize(
    ("value", "before", "at", "expected"),
    [
        (0.25, 0.0, 0.0, FaultCode.NONE),  # bend 0.25 = 16 * 0.125^2
        (just_above(0.25), 0.0, 0.0, FaultCode.SP_STEP),
        (0.5, -0.25, 0.0, FaultCode.NONE),  # step 0.5 = 4 * 0.125, bend 0.25
        (just_above(0.5), -0.25, 0.0, FaultCode.SP_STEP),
        (just_above(0.5), -0.4, 0.0, FaultCode.SP_STEP),  # the bend is small
        (0.0, -0.25, 0.0, FaultCode.NONE),
        (-1e-9, -0.25, 0.0, FaultCode.SP_STEP),
        (1.0, 0.5, 0.75, FaultCode.NONE),
        (just_above(1.0), 0.5, 0.75, FaultCode.SP_LIMIT),
        (-1.0, -0.5, -0.75, FaultCode.NONE),
        (just_below(-1.0), -0.5, -0.75, FaultCode.SP_LIMIT),
        (NAN, 0.0, 0.0, FaultCode.SP_INVALID),
        (INF, 0.0, 0.0, FaultCode.SP_INVALID),
        (-INF, 0.0, 0.0, FaultCode.SP_INVALID),
    ],
)
def test_a_setpoint_may_ask_for_what_the_joint_has_and_no_more(
    value: float, before: float, at: float, expected: int
) -> None:
    assert setpoint_verdict(value, before=before, at=at) == expected


def test_slack_widens_the_bend_allowed_after_an_extrapolated_knot() -> None:
    assert setpoint_verdict(0.4) == FaultCode.SP_STEP
    assert setpoint_verdict(0.4, slack=3.0) == FaultCode.NONE


@pytest.mark.parametrize(
    ("torque", "expected"),
    [(8.0, FaultCode.NONE), (-8.0, FaultCode.NONE), (just_above(8.0), FaultCode.SP_LIMIT), (NAN, FaultCode.SP_LIMIT)],
)
def test_a_torque_setpoint_stays_within_the_torque_limit(torque: float, expected: int) -> None:
    assert setpoint_verdict(torque, mode=2) == expected


def test_a_held_joint_is_not_judged() -> None:
    assert setpoint_verdict(NAN, mode=0) == FaultCode.NONE


def test_every_code_has_one_category_and_unknown_ones_cut_the_power() -> None:
    for code in FaultCode:
        assert category_of(code) == stop_category(code)
    assert category_of(255) == StopCategory.CATEGORY_0
    assert category_of(256) == StopCategory.CATEGORY_0
    assert category_of(-1) == StopCategory.CATEGORY_0


@pytest.mark.parametrize(
    "code", [FaultCode.BOARD_GONE, FaultCode.ENC_JUMP, FaultCode.RUNAWAY, FaultCode.ESTOP, FaultCode.GUARD_TRIP]
)
def test_what_robs_feedback_or_output_of_trust_cuts_the_power(code: FaultCode) -> None:
    assert stop_category(code) == StopCategory.CATEGORY_0
