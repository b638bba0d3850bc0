"""Telemetry of a rig in lock-step: whole, in order, and whoever asks for it has it for themselves."""

from __future__ import annotations

import numpy as np

from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.puma import ROBOT


def test_what_is_done_with_rows_changes_none_that_come_later_and_those_taken_do_not_come_again() -> None:
    rig = LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0), Emulator(ROBOT, physics="rigid"))
    assert rig.rows().size == 0
    rig.ticks(3)
    rig.ticks(2)
    rows = rig.rows()
    expected = rows.copy()
    rows["q"], rows["tick"] = np.nan, -1
    assert rig.rows().tobytes() == expected.tobytes()
    assert np.diff(expected["tick"]).tolist() == [1] * 4
    rig.ticks(4)
    assert rig.take_rows()["tick"].tolist() == list(range(expected["tick"][0], expected["tick"][0] + 9))
    assert rig.rows().size == 0
