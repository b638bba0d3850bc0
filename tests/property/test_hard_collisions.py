"""A slice of the campaign `hard_collisions`: a tool meets a wall while a program accelerates hard."""

from __future__ import annotations

import pytest

from qrobot.faultcodes import FaultCode
from tests.support.hard_collision import DRAWS, JOINTS, Case, HardTurn

SEEDS = range(2)


@pytest.mark.sampled(7)
@pytest.mark.parametrize("joints", JOINTS)
@pytest.mark.parametrize("draw", DRAWS)
def test_an_arm_that_meets_a_wall_while_it_accelerates_hard_is_stopped_for_that(
    joints: tuple[int, ...], draw: int | None
) -> None:
    codes = set()
    for seed in SEEDS:
        result = HardTurn(Case(joints, seed, draw)).run()
        assert result is not None
        assert result.honest, result
        codes.add(result.code)
    assert FaultCode.COLLISION in codes or joints == (1,)  # the blow of joint 2 alone may throw the others


def test_a_blow_that_stops_a_joint_within_milliseconds_is_no_dead_encoder() -> None:
    """Its counts become fewer before they end; the estimate of its velocity has not followed yet."""
    result = HardTurn(Case((0, 1, 2), 33)).run()
    assert result is not None
    assert result.code is FaultCode.COLLISION
