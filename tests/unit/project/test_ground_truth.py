"""tests/support/ground_truth.py: errors, lag and ripple of estimates whose answers are known."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.modecodes import Mode
from qrobot.servo.memory.telemetry import TelemetryLayout
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.ground_truth import GroundTruthRig, TrackedTruth

DT = 1e-3


def swinging(seconds: float = 4.0, lag_s: float = 0.0, offset: float = 0.0) -> TrackedTruth:
    """A swinging joint whose velocity is known late and off."""
    t = np.arange(round(seconds / DT)) * DT
    rows = TelemetryLayout(1).empty(t.size)
    rows["v"][:, 0] = np.sin(t - lag_s) + offset
    rows["a_ref"][:, 0] = np.where(t < 2.0, 1.0, 0.0)
    rows["tau"][:, 0] = 10.0 * t
    return TrackedTruth(rows, np.sin(t)[:, None], DT)


def test_a_constant_offset_is_the_rms_error() -> None:
    assert swinging(offset=0.02).velocity_error == pytest.approx([0.02])


def test_the_lag_is_found_and_an_offset_is_none() -> None:
    assert swinging(2 * np.pi, lag_s=0.004).lag_s == pytest.approx([0.004], rel=1e-3)
    assert swinging(2 * np.pi, offset=0.1).lag_s == pytest.approx([0.0], abs=1e-4)


def test_ripple_is_torque_beside_its_mean_and_counts_in_cruise_alone() -> None:
    seen = swinging()
    assert seen.ripple == pytest.approx([0.0], abs=1e-9)  # a straight climb has none
    seen.rows["tau"][1000] += 50.0  # while accelerating
    assert seen.ripple == pytest.approx([0.0], abs=1e-9)
    seen.rows["tau"][3000] += 2.9
    assert seen.ripple == pytest.approx([2.9 * 28 / 29])
    assert seen.torque_step == pytest.approx([50.01])


def test_tracking_errors_are_rms_and_largest() -> None:
    seen = swinging()
    seen.rows["q_ref"][::2] = 0.003
    assert seen.tracking_error == pytest.approx([0.003 / np.sqrt(2.0)])
    assert seen.largest_error == pytest.approx([0.003])


def test_the_truth_is_that_of_the_image_the_servo_saw() -> None:
    robot = load_robot("puma560")
    rig = GroundTruthRig(robot, ServoSettings(rate_hz=1000), Emulator(robot, physics="rigid"))
    rig.ticks(5)
    assert rig.tracked_truth().rows.size == 0  # nothing was tracked
    rig.state.mode = int(Mode.TRACKING)
    truth = rig.emulator.v
    rig.ticks(1)
    np.testing.assert_array_equal(rig._seen[-1], truth)
    assert len(rig._seen) == rig.rows().size
