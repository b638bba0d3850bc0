"""Samples of an arm as the pendant tells them."""

from __future__ import annotations

from math import inf, nan

import pytest

from qrobot.pendant.frames import HEAD, state_frame
from qrobot.wire import RobotState

NONE = (0.0,) * 6


@pytest.mark.parametrize(("told", "shown"), [(0.25, 250), (0.0, 0), (nan, 1000), (inf, 1000), (-1.0, 1000)])
def test_an_override_that_cannot_be_is_shown_as_full_speed_and_ends_nothing(told: float, shown: int) -> None:
    state = RobotState(t_ns=0, mode=5, q=NONE, v=NONE, tau=NONE, q_setpoint=NONE, override=told)
    assert HEAD.unpack_from(state_frame(0, state))[7] == shown
