"""The operator's pause and speed override at arms of Multi-RCCL that carry one object."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.multi_rccl import EQ, TL, TRANS, Manip, RobotManip, make_position, move, rccl_release, wait_as
from tests.contract.test_multi_rccl_kept import NAMES, apart, fakes, gentle
from tests.support.fake_robot import FakeRobot
from tests.support.kept_path import ROUNDING
from tests.support.puma import PERIOD_S
from tests.support.two_hands import HERE, THERE, carry, reach

__all__ = ["fakes"]  # the fixture

AWAY_S = 1.5  # an object's frame stands within that


def let_pass(arm: RobotManip, seconds: float) -> None:
    begin = arm.channel.how.t_ns
    wait_as(lambda: arm.channel.how.t_ns >= begin + seconds * 1e9)


def samples_of(obj: Manip, arm: RobotManip) -> int:
    """Samples until the object has arrived."""
    begin = arm.sample
    wait_as(lambda: obj.completed.count)
    return arm.sample - begin


@pytest.mark.parametrize("name", NAMES)
def test_an_object_that_two_hands_carry_stands_while_the_operator_pauses_either_arm(
    fakes: dict[str, FakeRobot], name: str
) -> None:
    obj, (left, right) = reach()
    held = apart(left, right)
    carry(obj)
    let_pass(left, 0.1)
    fakes[name].paused = True
    let_pass(left, AWAY_S)
    stood = obj.trans.value.copy(), left.j6.copy(), right.j6.copy()
    let_pass(left, AWAY_S)
    assert all((now == then).all() for now, then in zip((obj.trans.value, left.j6, right.j6), stood, strict=True))
    assert not obj.completed.count
    fakes[name].paused = False
    off = []

    def arrived() -> int:
        off.append(float(np.abs(apart(left, right) - held).max()))
        return obj.completed.count

    wait_as(arrived)
    assert np.abs(obj.trans.value - THERE.value).max() < ROUNDING
    assert max(off) < ROUNDING
    assert all(gentle(np.array(fakes[each].path)) for each in NAMES)


def test_an_object_goes_as_fast_as_the_slowest_arm_may(fakes: dict[str, FakeRobot]) -> None:
    obj, (left, _) = reach()
    carry(obj)
    full = samples_of(obj, left)
    fakes["right"].override = 0.5
    let_pass(left, PERIOD_S)
    move(obj, make_position(TRANS, EQ, HERE, TL, TRANS))
    assert 1.5 * full < samples_of(obj, left) < 2.5 * full


def test_an_arm_that_was_let_go_of_in_a_pause_holds_no_object(fakes: dict[str, FakeRobot]) -> None:
    obj, (left, right) = reach()
    fakes["right"].paused = True
    let_pass(left, AWAY_S)
    rccl_release(right)
    carry(obj)
    wait_as(lambda: obj.completed.count)
    assert np.abs(obj.trans.value - THERE.value).max() < ROUNDING
