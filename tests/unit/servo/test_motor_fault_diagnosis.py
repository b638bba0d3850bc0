"""The safety gate for motors, at and around every boundary: which symptom gets which name."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from qrobot.faultcodes import NO_JOINT
from qrobot.faultcodes import FaultCode as F
from qrobot.servo.checks.motor_fault_diagnosis import (
    FELT_SHARE,
    FROZEN_S,
    MOVING_PUSH_S,
    NOTICE_S,
    OVERDUE_COUNTS,
    OVERDUE_S,
    SIGN_DRIVE,
    SIGN_LEAST,
    SIGN_MOST,
    SIGN_S,
    STANDING_PUSH_S,
    STANDSTILL,
    SUSPECT_COUNTS,
    TURNED_S,
    WORK_S,
    acts_backwards,
    check_parked,
    check_push,
    check_saturation,
    counted_speed,
    counts_along,
    outruns,
    power_given,
    recent_work,
    stopped_dead,
)
from qrobot.servo.kernels.velocity import REST

NAN, INF = math.nan, math.inf


def above(x: float) -> float:
    return math.nextafter(x, INF)


def below(x: float) -> float:
    return math.nextafter(x, -INF)


# a joint pushed backwards by more than its threshold, long enough to be told of, and still moving forwards
PUSHED: dict[str, Any] = {
    "push": -10.0, "limit": 8.0, "over_s": 0.01, "drive": 1.0, "v": 0.2, "v_ref": 0.5, "margin": 0.125,
    "still_s": 0.0, "overdue": 0.0, "impossible": 64.0, "taken": False, "proven": False,
}  # fmt: skip


def verdict(**changes: Any) -> int:
    return check_push(*(PUSHED | changes).values())


@pytest.mark.parametrize("push", [8.0, -8.0, 0.0])
def test_a_push_up_to_the_threshold_is_nothing(push: float) -> None:
    assert verdict(push=push, over_s=9.0, still_s=9.0) == F.NONE


@pytest.mark.parametrize("push", [above(8.0), -above(8.0), INF, -INF, NAN])
def test_a_push_above_it_or_without_number_is_a_collision(push: float) -> None:
    assert verdict(push=push, v=0.0) == F.COLLISION


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"over_s": below(NOTICE_S)}, F.NONE),
        ({"over_s": NOTICE_S}, F.COLLISION),
        ({"over_s": below(MOVING_PUSH_S)}, F.COLLISION),
        ({"over_s": MOVING_PUSH_S}, F.DAC_STUCK),
        ({"over_s": MOVING_PUSH_S, "v": STANDSTILL}, F.COLLISION),
        ({"over_s": MOVING_PUSH_S, "v": -above(STANDSTILL), "v_ref": -1.0}, F.DAC_STUCK),
        ({"over_s": below(STANDING_PUSH_S), "v": 0.0}, F.COLLISION),
        ({"over_s": STANDING_PUSH_S, "v": 0.0}, F.DAC_STUCK),
    ],
)
def test_a_push_is_a_collision_from_when_it_is_noticed_until_no_stop_ends_it(
    changes: dict[str, float], expected: F
) -> None:
    assert verdict(**changes) == expected


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"still_s": below(FROZEN_S)}, F.COLLISION),
        ({"still_s": FROZEN_S}, F.ENC_STUCK),
        ({"still_s": FROZEN_S, "over_s": 0.0}, F.ENC_STUCK),
        ({"overdue": below(SUSPECT_COUNTS)}, F.COLLISION),
        ({"overdue": SUSPECT_COUNTS}, F.NONE),
        ({"overdue": SUSPECT_COUNTS, "still_s": FROZEN_S}, F.ENC_STUCK),
    ],
)
def test_a_joint_that_counts_nothing_while_it_is_pushed_has_a_dead_encoder_or_a_closed_brake(
    changes: dict[str, Any], expected: F
) -> None:
    assert verdict(**changes) == expected


@pytest.mark.parametrize(
    ("push", "v", "v_ref", "expected"),
    [
        (10.0, 0.625, 0.5, F.COLLISION),
        (10.0, above(0.625), 0.5, F.RUNAWAY),
        (10.0, 0.625, -0.5, F.COLLISION),
        (-10.0, -above(0.625), 0.5, F.RUNAWAY),
        (10.0, -1.0, 0.5, F.COLLISION),
        (-10.0, 1.0, 0.5, F.COLLISION),
        (10.0, above(0.125), 0.0, F.RUNAWAY),
        (8.5, 0.1, 0.0, F.COLLISION),
    ],
)
def test_a_joint_driven_faster_than_its_reference_runs_away(push: float, v: float, v_ref: float, expected: F) -> None:
    assert verdict(push=push, v=v, v_ref=v_ref) == expected


def test_a_joint_thrown_about_by_what_takes_energy_from_the_arm_does_not_run_away() -> None:
    thrown = {"push": 10.0, "v": 2.0, "taken": True}
    assert verdict(**thrown, over_s=below(NOTICE_S)) == F.NONE
    assert verdict(**thrown, over_s=NOTICE_S) == F.COLLISION
    assert verdict(**thrown, over_s=MOVING_PUSH_S) == F.DAC_STUCK
    assert verdict(**thrown, still_s=FROZEN_S) == F.ENC_STUCK


def test_a_light_joint_runs_away_too() -> None:
    assert verdict(push=1.0, limit=0.5, v=0.7, v_ref=0.5) == F.RUNAWAY


def test_a_runaway_is_named_at_once() -> None:
    assert verdict(push=10.0, v=2.0, over_s=0.0, overdue=SUSPECT_COUNTS) == F.RUNAWAY
    assert outruns(1.0, NAN, 0.0, 1.0) is False or outruns(1.0, NAN, 0.0, 1.0) == 0


@pytest.mark.parametrize(
    ("push", "drive", "v", "expected"),
    [
        (-10.0, 5.0, -0.1, True),
        (10.0, -5.0, 0.1, True),
        (10.0, 5.0, -0.1, False),
        (-10.0, 5.0, 0.0, False),
        (-10.0, 5.0, 0.1, False),
        (-SIGN_LEAST * 5.0, 5.0, -0.1, True),
        (below(SIGN_LEAST * 5.0), -5.0, 0.1, False),
        (SIGN_MOST * 5.0, -5.0, 0.1, True),
        (above(SIGN_MOST * 5.0), -5.0, 0.1, False),
        (-2.0 * SIGN_DRIVE * 8.0, SIGN_DRIVE * 8.0, -0.1, True),
        (-2.0 * SIGN_DRIVE * 8.0, below(SIGN_DRIVE * 8.0), -0.1, False),
        (0.0, 5.0, -0.1, False),
    ],
)
def test_a_joint_acts_backwards_when_it_goes_against_its_torque_as_hard_as_it_should_with_it(
    push: float, drive: float, v: float, expected: bool
) -> None:
    assert acts_backwards(push, drive, v, 8.0) == expected


def test_a_light_joint_that_is_pushed_along_does_not_act_backwards() -> None:
    assert not acts_backwards(1.0, 0.5, -0.1, 0.1)


def test_such_a_joint_has_a_wrong_sign() -> None:
    backwards = {"push": -10.0, "drive": 5.0, "v": -0.1}
    assert verdict(**backwards, over_s=below(NOTICE_S)) == F.NONE
    assert verdict(**backwards, over_s=NOTICE_S) == F.ENC_SIGN
    assert verdict(**backwards, over_s=below(SIGN_S)) == F.ENC_SIGN
    assert verdict(**backwards, over_s=SIGN_S) == F.COLLISION


@pytest.mark.parametrize("known", ["proven", "taken"])
def test_a_joint_whose_sign_is_right_has_hit_something(known: str) -> None:
    backwards = {"push": -10.0, "drive": 5.0, "v": -0.1, "over_s": NOTICE_S, known: True}
    assert verdict(**backwards) == F.COLLISION
    turned = {"push": -above(64.0), "v": -above(STANDSTILL), "over_s": NOTICE_S, known: True}
    assert verdict(**turned) == F.COLLISION
    assert verdict(**turned | {"v": 0.2}) == F.COLLISION


@pytest.mark.parametrize(
    ("along", "step", "torque", "expected"),
    [
        (100, 3, 5.0, 103),
        (100, -3, -5.0, 103),
        (100, 3, -5.0, 97),
        (100, -3, 5.0, 97),
        (100, 3, 0.0, 97),
        (100, 0, 5.0, 100),
        (2, 3, -5.0, 0),
        (3, 2, -5.0, 1),
        (0, 3, -0.125, 0),
        (249, 4, 0.125, 253),
        (249, 4, -0.125, 245),
        (250, 4, 5.0, 250),
        (253, 9, -5.0, 253),
        (100, 3, NAN, 97),
    ],
)
def test_the_way_along_the_torque_is_counted_until_there_is_enough_of_it(
    along: int, step: int, torque: float, expected: int
) -> None:
    assert counts_along(along, step, torque, 250.0) == expected


@pytest.mark.parametrize(
    ("push", "v", "expected"),
    [
        (10.0, -0.5, -5.0),
        (-10.0, -0.5, 5.0),
        (8.0 * FELT_SHARE, 0.5, 0.0),
        (above(8.0 * FELT_SHARE), 0.5, 0.5 * above(8.0 * FELT_SHARE)),
        (-8.0 * FELT_SHARE, 0.5, 0.0),
        (-above(8.0 * FELT_SHARE), 0.5, -0.5 * above(8.0 * FELT_SHARE)),
        (0.0, 0.5, 0.0),
    ],
)
def test_a_push_that_the_model_does_not_explain_gives_power_or_takes_it(push: float, v: float, expected: float) -> None:
    assert power_given(push, v, 8.0) == expected


def test_work_is_the_sum_of_power_and_is_forgotten() -> None:
    assert recent_work(0.0, -8.0, 0.25) == -2.0
    assert recent_work(2.0, 0.0, WORK_S / 2) == 1.0
    assert recent_work(-2.0, 4.0, WORK_S / 2) == -1.0 + 2.0 * WORK_S
    assert recent_work(2.0, 3.0, 2.0) == 6.0
    work, dt = -1.0, WORK_S / 1000
    for _ in range(30_000):
        work = recent_work(work, 0.0, dt)
        assert work == 0.0 or work <= -REST  # no denormal number, however long ago the blow was
    assert work == 0.0


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"push": -64.0}, F.COLLISION),
        ({"push": -above(64.0)}, F.NONE),
        ({"push": -above(64.0), "over_s": TURNED_S}, F.COLLISION),
        ({"push": -above(64.0), "v": -STANDSTILL}, F.NONE),
        ({"push": -above(64.0), "v": -above(STANDSTILL)}, F.ENC_SIGN),
        ({"push": above(64.0), "v": above(STANDSTILL), "v_ref": -0.5}, F.ENC_SIGN),
        ({"push": -64.0, "v": -above(STANDSTILL)}, F.COLLISION),
        ({"push": -above(64.0), "v": -above(STANDSTILL), "v_ref": 0.0}, F.NONE),  # the reference stands
        ({"push": -above(64.0), "v": -above(STANDSTILL), "over_s": TURNED_S}, F.COLLISION),
    ],
)
def test_a_joint_that_turns_round_harder_than_any_torque_can_make_it_counts_backwards(
    changes: dict[str, float], expected: F
) -> None:
    assert verdict(**{"over_s": below(TURNED_S)} | changes) == expected


COUNT, INERTIA, IMPOSSIBLE = 2.0**-10, 4.0, 128.0


@pytest.mark.parametrize(
    ("still_s", "v", "expected"),
    [
        (2.0**-8, 4.0, True),
        (2.0**-8, -4.0, True),
        (0.0, 4.0, False),
        (0.0, 1e6, False),
        (below(OVERDUE_S), 8.0, False),
        (OVERDUE_S, 8.0, True),
        (2.0**-7, OVERDUE_COUNTS * 2.0**-3, True),
        (2.0**-7, below(OVERDUE_COUNTS * 2.0**-3), False),
        (2.0**-3, 4.0, False),  # 128 N m stop it in just that time
        (below(2.0**-3), 4.0, True),
        (NAN, 4.0, False),
    ],
)
def test_a_fast_joint_without_counts_has_a_dead_encoder_unless_something_could_have_stopped_it(
    still_s: float, v: float, expected: bool
) -> None:
    assert stopped_dead(still_s, v, COUNT, INERTIA, IMPOSSIBLE, 0.0) == expected


def test_a_push_from_before_the_last_count_has_been_seen_by_an_encoder_that_lives() -> None:
    assert stopped_dead(2.0**-8, 4.0, COUNT, INERTIA, IMPOSSIBLE, 2.0**-8)
    assert not stopped_dead(2.0**-8, 4.0, COUNT, INERTIA, IMPOSSIBLE, above(2.0**-8))


@pytest.mark.parametrize(
    ("clipped_s", "expected"), [(0.0, F.NONE), (0.5, F.NONE), (above(0.5), F.SATURATED), (NAN, F.SATURATED)]
)
def test_a_torque_may_stay_at_its_limit_for_so_long(clipped_s: float, expected: F) -> None:
    assert check_saturation(clipped_s, 0.5) == expected


@pytest.mark.parametrize(
    ("q", "expected"),
    [
        ([0.125, -0.25, 9.0], (F.NONE, NO_JOINT)),
        ([above(0.125), 0.0, 0.0], (F.BRAKE_SLIP, 0)),
        ([0.0, -above(0.25), 0.0], (F.BRAKE_SLIP, 1)),
        ([0.0, NAN, 0.0], (F.BRAKE_SLIP, 1)),
    ],
)
def test_a_parked_joint_with_a_brake_stays_within_the_slip_allowed(q: list[float], expected: tuple[int, int]) -> None:
    brake, slip = np.array([1, 1, 0]), np.array([0.125, 0.25, 0.125])
    assert check_parked(np.array(q), np.zeros(3), brake, slip) == expected
    parked = np.array([0.5, -2.0, 0.0])
    assert check_parked(parked, parked, brake, slip) == (F.NONE, NO_JOINT)
    assert check_parked(-parked, parked, brake, slip) == (F.BRAKE_SLIP, 0)


@pytest.mark.parametrize(
    ("v", "v_before", "step", "before", "expected"),
    [
        (4.0, 4.0, 8, 8, 4.0),
        (-4.0, -4.0, -8, -8, -4.0),
        (4.0, 4.0, 3, 8, 4.0),  # the part of a cycle in which an encoder that dies still counted
        (4.0, 4.0, 3, 6, 3.0),  # within rounding of 0.875 v
        (4.0, 4.0, 3, 5, 1.5),  # a blow: the estimate has not followed yet
        (-4.0, -4.0, -3, -5, -1.5),
        (3.0, 4.0, 3, 5, 1.5),  # nor is what it was
        (3.0, 3.0, 3, 5, 2.5),
        (4.0, 0.0, 5, 3, 2.5),
        (1.0, 0.0, 1, 1, 0.5),
        (0.25, 0.25, 1, 0, 0.25),  # a slow joint counts once in some cycles
        (2.0, -2.0, 1, -3, 1.5),  # it has turned round
    ],
)
def test_a_joint_was_no_faster_than_it_has_counted(
    v: float, v_before: float, step: int, before: int, expected: float
) -> None:
    assert counted_speed(v, v_before, step, before, 0.5) == expected
