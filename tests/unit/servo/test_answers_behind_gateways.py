"""What a servo takes for the answer of a board behind a gateway, whose image does not show what came with its asking.

The far board counts several images between two exchanges, and an exchange takes some cycles of the servo.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from qrobot.faultcodes import FaultCode
from qrobot.hwif.board_memory import LANE_CAPACITY, PANEL_MICRO, Lane
from qrobot.hwif.bus import safe_operations
from qrobot.hwif.lanes import post_operations
from qrobot.hwif.registers import DISCRETE_CALIBRATED, N_ADCS
from qrobot.modecodes import Mode
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.operator.calibration_client import run_calibration
from qrobot.servo.settings import ServoSettings
from qrobot.servo.state import ADOPT_BOARD
from qrobot.sim_board.emulator import Emulator
from tests.support.calibrating import PUMA, TABLE, random_pose
from tests.support.transport_rig import RareRig

# cycles of the servo to an exchange, and those in which it is under way
EXCHANGES = [(1, 0), (2, 0), (2, 1), (5, 3)]


def rare_rig(cycles: int, lasts: int, start: Any = "park", calibrated: bool = True, **settings: Any) -> RareRig:
    """An arm at rest behind such a board."""
    pots = settings.get("calibration") is not None
    plant = Emulator(PUMA, physics="rigid", start=start, calibrated=calibrated, pots=pots)
    servo = ServoSettings(rate_hz=1000.0, pots=pots, board_timeout_ms=20.0, **settings)
    return RareRig(PUMA, servo, plant, cycles, keep_telemetry=False, lasts=lasts)


@pytest.mark.parametrize(("cycles", "lasts"), EXCHANGES)
def test_each_channel_shows_its_own_voltage(cycles: int, lasts: int) -> None:
    rig, volts = rare_rig(cycles, lasts, sensor_channels=tuple(range(N_ADCS))), 0.5 * np.arange(N_ADCS) + 0.1
    rig.end.memory.panel.analog[:] = np.rint(volts * PANEL_MICRO).astype(np.int64)
    done = rig.state.adc.done
    while done.min() < 2:
        rig.ticks(1)
        np.testing.assert_allclose(rig.state.sensors[done > 0], volts[done > 0], atol=0.01)
    assert rig.state.adc.timeouts == 0


@pytest.mark.parametrize(("cycles", "lasts"), EXCHANGES)
def test_an_index_latch_that_is_armed_at_rest_has_seen_no_pulse(cycles: int, lasts: int) -> None:
    """A latch nobody waits for shows the same as one that has seen a pulse."""
    rig = rare_rig(cycles, lasts, calibration=TABLE)
    rig.mailbox.request_power(True)
    rig.run_for(0.2 * cycles)
    assert rig.state.index_watch.armed
    assert (Mode(rig.state.mode), rig.state.event) == (Mode.HOLDING, FaultCode.NONE)


@pytest.mark.parametrize(("cycles", "lasts"), [(2, 0), (2, 1)])
def test_a_calibration_takes_no_pulse_twice_and_the_watch_after_it_none_of_its_latches(cycles: int, lasts: int) -> None:
    rig = rare_rig(cycles, lasts, random_pose(1), calibrated=False, calibration=TABLE)
    rig.mailbox.request_power(True)
    rig.run_for(1.0)
    report = run_calibration(rig.mailbox, rig.run_for, 3)
    assert report.votes == [3] * PUMA.n
    rig.run_for(0.1)
    assert (Mode(rig.state.mode), rig.state.event) == (Mode.HOLDING, FaultCode.NONE)


def test_a_conversion_that_no_board_was_told_of_is_not_waited_for() -> None:
    """The lane is full, or the guardian has the board: what it shows is the answer to an earlier question."""
    rig = LockstepRig(PUMA, ServoSettings(sensor_channels=(0, 1)), Emulator(PUMA, physics="rigid"))
    rig.ticks(20)
    refused = 0
    for _ in range(4 * LANE_CAPACITY):
        begun = rig.state.adc.begun
        rig.compute()
        if rig.state.adc.begun > begun and rig.state.discrete_sent == -1:
            refused += 1
            assert rig.state.adc.busy == 0
    assert refused


def test_a_board_that_is_found_again_answers_no_conversion_of_before() -> None:
    """What was posted while it was lost was dropped; what its converter shows is older still."""
    rig = rare_rig(2, 0, sensor_channels=(0, 1))
    adc = rig.state.adc
    rig.run_for(0.1)
    while adc.busy == 0:
        rig.ticks(1)
    done, begun, rig.state.adopt = adc.done.sum(), adc.begun, ADOPT_BOARD
    while rig.state.adopt == ADOPT_BOARD:
        rig.ticks(1)
    assert (adc.done.sum(), adc.begun) == (done, begun + 1)


def test_power_that_a_gateway_has_taken_with_the_index_masks_is_no_lost_count() -> None:
    """One that finds its board again makes it safe first: the bits that tell of pulses are then closed, not low."""
    plant = Emulator(PUMA, physics="rigid", pots=True)
    rig = LockstepRig(PUMA, ServoSettings(rate_hz=1000.0, pots=True, calibration=TABLE), plant)
    rig.mailbox.request_power(True)
    rig.run_for(0.5)
    assert rig.state.index_watch.armed
    assert Mode(rig.state.mode) is Mode.HOLDING
    safe = safe_operations(int(rig.state.status))
    assert post_operations(rig.board, int(Lane.TOOL), safe, len(safe), rig.now_ns)
    rig.run_for(0.05)
    assert (Mode(rig.state.mode), rig.state.fault) == (Mode.FAULT, FaultCode.POWER_LOST)
    assert rig.state.discrete_word & DISCRETE_CALIBRATED
