"""Cartesian programs through bridge, servo, emulated board and plant, on virtual time: the measured tool follows."""

from __future__ import annotations

import runpy
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from qrobot import rccl
from qrobot.modecodes import Mode
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.puma import LIMITS, ROBOT, arm, shift

EXAMPLES = Path(__file__).parents[2] / "examples"
TIP = shift(z=0.1).value
SAMPLE_US = 28_000
EVERY = 20  # servo cycles between two looks


def run(name: str) -> np.ndarray:
    """Telemetry of the cycles in which the arm followed setpoints, every twentieth."""
    rig = LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0), Emulator(ROBOT))
    with rccl.use(partial(link_factory, rig, SAMPLE_US)):
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    rows = rig.rows()
    assert not rows["fault"].any()
    return rows[rows["mode"] == Mode.TRACKING][::EVERY]


def tips(joints: np.ndarray) -> np.ndarray:
    """The tip of the tool, mm. Shape (k, 3)."""
    return 1000.0 * np.array([(arm().forward(q) @ TIP)[:3, 3] for q in joints])


@pytest.mark.parametrize("name", ["02_four_corners.py", "06_conveyor.py"])
def test_the_measured_tool_follows_a_cartesian_program_within_the_servos_error(name) -> None:
    rows = run(name)
    wanted, measured = tips(rows["q_ref"]), tips(rows["q"])
    assert np.linalg.norm(measured - wanted, axis=1).max() < 2.0
    assert np.ptp(measured, axis=0).max() > 100.0
    assert (np.abs(rows["v_ref"]) <= 1.1 * LIMITS.v_max).all()
