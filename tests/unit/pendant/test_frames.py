"""Samples of an arm as the pendant tells them."""

from __future__ import annotations

from math import inf, nan

import pytest

from qrobot.pendant.frames import HEAD, state_frame
from qrobot.wire import RobotState, State
from qrobot.wire.vocabulary import RobotFlag

NONE = (0.0,) * 6


@pytest.mark.parametrize(("told", "shown"), [(0.25, 250), (0.0, 0), (nan, 1000), (inf, 1000), (-1.0, 1000)])
def test_an_override_that_cannot_be_is_shown_as_full_speed_and_ends_nothing(told: float, shown: int) -> None:
    robot = RobotState(t_ns=0, mode=5, q=NONE, v=NONE, tau=NONE, q_setpoint=NONE, override=told)
    assert HEAD.unpack_from(state_frame(0, State(0, robot)))[7] == shown


@pytest.mark.parametrize("waits", [False, True])
def test_a_page_is_told_that_a_program_waits_beside_its_path(waits: bool) -> None:
    robot = RobotState(t_ns=0, mode=5, q=NONE, v=NONE, tau=NONE, q_setpoint=NONE, flags=RobotFlag.PAUSED)
    flags = HEAD.unpack_from(state_frame(0, State(0, robot, path_waits=waits)))[8]
    assert RobotFlag(flags) == (RobotFlag.PAUSED | RobotFlag.PATH_WAITS if waits else RobotFlag.PAUSED)
