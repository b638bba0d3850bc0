"""A payload in the hand of the emulated arm, with and without the servo's knowing of it."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from qrobot import rccl
from qrobot.errors import MotionError
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.wire import Payload
from tests.support.puma import ROBOT

LOAD = Payload(2.5)
ELBOW = 2


def swung(physics: Literal["mujoco", "rigid"], told: bool) -> LockstepRig:
    """A swing of shoulder and elbow there and back with 2.5 kg at the flange."""
    settings = ServoSettings(rate_hz=1000.0, law="computed-torque")
    rig = LockstepRig(ROBOT, settings, Emulator(ROBOT, physics=physics, payload_kg=LOAD.mass))
    with rccl.use(lambda hello: link_factory(rig, 28_000, hello)), rccl.control(ROBOT.name) as arm:
        if told:
            arm.setload(LOAD.mass)
        for name in ("ready", "park"):
            arm.move(arm.pose(name))
        arm.waitfor(arm.completed)
    return rig


def error(rig: LockstepRig) -> float:
    """Greatest tracking error of the elbow under way after the first second, rad."""
    rows = rig.rows()[1500:]
    moving = rows[rows["v_ref"].any(axis=1)]
    return float(np.abs(moving["q_ref"] - moving["q"])[:, ELBOW].max())


@pytest.mark.parametrize("physics", ["mujoco", "rigid"])
def test_an_arm_that_knows_its_load_tracks_better_and_finds_fewer_torques_that_nobody_commanded(physics) -> None:
    knowing, ignorant = swung(physics, told=True), swung(physics, told=False)
    assert error(knowing) < 0.2 * error(ignorant)
    unexplained = np.abs(knowing.state.watch.push), np.abs(ignorant.state.watch.push)
    assert (unexplained[0][1:3] < 0.25 * unexplained[1][1:3]).all()
    assert (unexplained[1][1:3] > 0.5 * ROBOT.guard.unknown_load[1:3]).all()  # what a COLLISION is judged by


def test_a_load_that_the_arm_cannot_carry_reaches_the_program_as_an_error() -> None:
    rig = LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0), Emulator(ROBOT, physics="rigid", start="ready"))
    with rccl.use(lambda hello: link_factory(rig, 28_000, hello)), rccl.control(ROBOT.name) as arm:
        arm.setload(1.0, (0.0, 0.0, 40.0), (0.001, 0.001, 0.001, 0.0, 0.0, 0.0))
        for kg, centre, why in ((5.0, (0, 0, 0), "carries 2.5 kg"), (2.4, (0, 0, 900), "would have to hold")):
            with pytest.raises(MotionError, match=why):
                arm.setload(kg, centre)
        assert arm.how.payload_mass == 1.0
        for k in range(15):  # also of a mass that is carried already, and as often as one likes
            with pytest.raises(MotionError, match="too far from the flange"):
                arm.setload(1.0 + k % 2, (0.0, 0.0, 2500.0))
        began = arm.time
        arm.setload(1.0, (0.0, 0.0, 60.0))
        assert arm.time - began >= 500.0  # ms, in which the servo goes over to it
        arm.setload(0)
    assert rig.mailbox.snapshot().payload_mass == 0.0
