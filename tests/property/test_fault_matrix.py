"""A slice of the campaign of `python -m tests.fault_matrix`: every fault under some of its many conditions.

Without a fault nothing stops the arm, whatever its speed, its load and the frames of its stream; with one no joint goes
further from its path than the bound while it has torque.
"""

from __future__ import annotations

import pytest

from tests.fault_matrix.campaign import FAULTS, Fault, conditions, run

EVERY = 61  # of the conditions: a slice in which each value of each comes up


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_no_joint_strays_and_nothing_stops_for_nothing(fault: Fault) -> None:
    rows = run(fault, conditions(EVERY))
    assert len(rows) >= 5
    assert [f"{row.conditions}: {row.wrong}" for row in rows if row.wrong] == []


def test_the_slice_has_every_speed_stream_load_and_start() -> None:
    chosen = list(conditions(EVERY))
    everything = list(conditions())
    for value in ("joint", "speed", "moving", "loaded", "stream", "direction"):
        assert {getattr(each, value) for each in chosen} == {getattr(each, value) for each in everything}
