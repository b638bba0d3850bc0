"""A slice of the campaign of `python -m tests.fault_matrix`: every fault under some of its many conditions.

Without a fault nothing stops the arm, whatever its speed, its load and the frames of its stream; with one no joint goes
further from its path than the bound while it has torque.
"""

from __future__ import annotations

import math

import pytest

from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from tests.fault_matrix.campaign import FAULTS, STRAY_DEG, Fault, Row, conditions, run
from tests.fault_matrix.trial import Conditions, Result, Trial

EVERY = 89  # of the conditions: a slice in which each value of each comes up


@pytest.mark.sampled(3)
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_no_joint_strays_and_nothing_stops_for_nothing(fault: Fault) -> None:
    rows = run(fault, conditions(EVERY))
    assert len(rows) >= 5
    assert [f"{row.conditions}: {row.wrong}" for row in rows if row.wrong] == []


def test_a_fault_that_is_not_noticed_at_rest_is_out_of_bounds_but_where_it_may_harm_nothing() -> None:
    nothing = Result(FaultCode.NONE, FaultCode.NONE, Mode.TRACKING, math.inf, math.inf, 0.0, 0.0, 0.5, False)
    let_pass = {fault.name for fault in FAULTS if not Row(fault, Conditions(0, 0.1, moving=False), nothing).wrong}
    assert let_pass == {"nothing", "motor dead", "motor torque stuck", "brake closed"}


def test_the_slice_has_every_speed_stream_load_and_start() -> None:
    chosen = list(conditions(EVERY))
    everything = list(conditions())
    for value in ("joint", "speed", "moving", "loaded", "stream", "direction"):
        assert {getattr(each, value) for each in chosen} == {getattr(each, value) for each in everything}


@pytest.mark.parametrize(
    "conditions", [Conditions(0, 0.1, True, True), Conditions(0, 0.5, False, True, direction=-1)], ids=str
)
def test_an_encoder_that_turned_round_and_was_taken_for_a_collision_lets_no_motion_pass(conditions: Conditions) -> None:
    trial = Trial(conditions)
    first = trial.run("encoder:1 reversed")
    assert first.code is FaultCode.COLLISION
    stopped, way = trial.move_again()
    assert stopped
    assert math.degrees(way) < STRAY_DEG
