"""Benchmarks of running processes (benchmarks/busy.py, benchmarks/guardian.py): what they call a failure."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.busy import START_S, Busy
from benchmarks.guardian import Reactions
from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode


def snapshot(mode: Mode, event: FaultCode = FaultCode.NONE) -> Any:
    zeros = np.zeros(6)
    return SimpleNamespace(mode=mode, event=event, q=zeros, q_setpoint=zeros, missed_frames=0, late_cycles=3)


@pytest.mark.parametrize(
    ("mode", "event", "fails"),
    [
        (Mode.TRACKING, FaultCode.NONE, False),
        (Mode.HOLDING, FaultCode.NONE, False),
        (Mode.HOLDING, FaultCode.STREAM_LOST, True),
        (Mode.FAULT, FaultCode.FOLLOWING, True),
        (Mode.OFF, FaultCode.NONE, True),
    ],
)
def test_an_arm_that_was_stopped_beside_busy_programs_is_told_once_it_has_started(
    mode: Mode, event: FaultCode, fails: bool
) -> None:
    found = Busy()
    found.look(snapshot(mode, event), START_S)  # it may be on its way to power
    assert found.events == []
    found.look(snapshot(mode, event), START_S + 1.0)
    assert bool(found.events) == fails
    assert found.late_cycles == 3


def test_a_guardian_that_takes_longer_than_twice_its_bound_or_for_ever_is_late() -> None:
    assert Reactions(5.0, [5.5, 9.9, 10.0]).late == 0
    assert Reactions(5.0, [5.5, 10.1, float("nan")]).late == 2
