"""Emulated arms whose wrist falls when they are made: lock-step waits for nobody, so somebody has to wait."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from qrobot import rccl
from qrobot.config import load_robot
from qrobot.errors import ServoFault
from qrobot.modecodes import Mode
from qrobot.rig.fallen_arm import control_at_rest
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.rig.perturbed_arm import PerturbedArm
from qrobot.servo.settings import ServoSettings

PERIOD_US = 28_000
STANFORD = load_robot("stanford")


def drawn(seed: int) -> LockstepRig:
    """A Stanford arm drawn at random, whose friction does not hold its wrist."""
    emulator = PerturbedArm.drawn(STANFORD, seed, True).emulator()
    return LockstepRig(STANFORD, ServoSettings(rate_hz=500.0), emulator)


def test_an_arm_whose_wrist_falls_is_powered_once_it_has_come_to_rest() -> None:
    rig = drawn(0)
    with rccl.use(partial(link_factory, rig, PERIOD_US)), pytest.raises(ServoFault, match="MOVING_AT_START"):
        rccl.control("stanford")
    rig = drawn(0)
    with control_at_rest(rig, "stanford", PERIOD_US) as arm:
        assert arm.how.mode == Mode.TRACKING
    fallen = rig.rows()["q"][-1] - STANFORD.poses["park"]
    assert np.abs(fallen[3:5]).min() > 1.0  # both hang


def test_an_arm_that_stands_is_powered_at_once() -> None:
    robot = load_robot("puma560")
    rig = LockstepRig(robot, ServoSettings(rate_hz=500.0), PerturbedArm.drawn(robot, 0, True).emulator())
    with control_at_rest(rig, "puma560", PERIOD_US):
        assert rig.rows().size < 1.0 * 500
