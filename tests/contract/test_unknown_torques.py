"""Calls that act by torques, of an arm whose drives close the position loop: each is refused, and nothing is told."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from qrobot import rccl, rci
from qrobot.cli.identify import record
from qrobot.config import load_robot
from qrobot.config.collision import NO_TORQUES
from qrobot.errors import ConfigError, IdentificationError, MotionError, QRobotError
from qrobot.hwif.bus import Endpoint
from qrobot.hwif.canbus.drives import DrivesBus
from qrobot.ident.recording import check_recording
from qrobot.modecodes import Mode
from qrobot.rig.lockstep import link_factory
from qrobot.servo.operator.messages import ChangeCollision
from qrobot.servo.operator.motion_requests import set_collision
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.val.arcl_arm import arcl_arm
from qrobot.val.rccl_arm import RcclArm
from tests.support.drives import INCREMENTS, NODES, loops_for, served, torque_for
from tests.support.transport_rig import TransportRig

ROBOT = load_robot("puma560")
SETTINGS = ServoSettings(rate_hz=500.0, position_drives=True)
LOW = (0.5 * ROBOT.guard.unexplained_torque_or_default).tolist()
PERIOD_US = 28_000


DRIVES = f"""
[[arm]]
name = "lab"
robot = "puma560"
bridge = {{ port = 5600 }}
servo = {{ rate_hz = 500, board_timeout_ms = 10 }}

[arm.board]
kind = "drives"

[arm.board.drives]
interface = "virtual"
channel = "can0"
mode = "position"
nodes = {list(NODES)}
increments_per_count = {list(INCREMENTS)}
counts_at_zero = [0, 0, 0, 0, 0, 0]
absolute = true
"""


@contextmanager
def on_drives() -> Iterator[TransportRig]:
    """The arm on drives of CiA 402 in position mode."""
    with ExitStack() as stack:

        def open_bus(end: Endpoint) -> DrivesBus:
            loops = loops_for(ROBOT, SETTINGS.period_ns * 1e-9)
            return stack.enter_context(served(end, torque=torque_for(ROBOT), loops=loops)).bus

        yield TransportRig(ROBOT, SETTINGS, open_bus, Emulator(ROBOT, physics="rigid"))


@pytest.fixture(scope="module")
def rig() -> Iterator[TransportRig]:
    with on_drives() as rig:
        yield rig


@pytest.fixture(scope="module")
def arm(rig: TransportRig) -> Iterator[rccl.Channel]:
    with rccl.use(partial(link_factory, rig, PERIOD_US)), rccl.control() as arm:
        yield arm


RCCL: dict[str, Callable[[rccl.Channel], object]] = {
    "limit": lambda arm: arm.limit("dz fz", 5.0, 15.0),
    "exerted": lambda arm: arm.exerted,
    "comply": lambda arm: arm.comply("fz", 5.0),
    "thresholds": lambda arm: arm.collision("stop", LOW),
    "soft": lambda arm: arm.collision("comply"),
    "back": lambda arm: arm.collision("retract"),
    "retract": lambda arm: arm.retract(20.0),
    "VAL's thresholds": lambda arm: RcclArm(arm).collision("stop", np.array(LOW)),
    "VAL's COMPLY": lambda arm: RcclArm(arm).collision("comply", None),
    "VAL's RETRACT": lambda arm: RcclArm(arm).retract(20.0),
}


@pytest.mark.parametrize("call", RCCL.values(), ids=RCCL)
def test_a_call_of_rccl_that_acts_by_torques_is_refused(
    arm: rccl.Channel, call: Callable[[rccl.Channel], object]
) -> None:
    with pytest.raises(MotionError, match=NO_TORQUES):
        call(arm)


def test_what_needs_no_torques_is_done(arm: rccl.Channel) -> None:
    arm.collision("stop")
    arm.retract(0.0)
    arm.limit("dz", 5.0)
    goal = arm.joints
    goal[0] += 2.0
    arm.move(arm.jposition("beside", goal.tolist()))
    arm.waitfor(arm.completed)
    np.testing.assert_allclose(arm.joints, goal, atol=0.2)
    assert Mode(arm.how.mode) is Mode.TRACKING


def test_so_is_a_call_of_arcl() -> None:
    with on_drives() as rig, rci.use(partial(link_factory, rig, PERIOD_US)), arcl_arm(ROBOT) as arm:
        calls: list[Callable[[], object]] = [
            lambda: arm.collision("stop", np.array(LOW)),
            lambda: arm.collision("comply", None),
            lambda: arm.retract(20.0),
        ]
        for call in calls:
            with pytest.raises(MotionError, match=NO_TORQUES):
                call()
        arm.collision("stop", None)
        arm.retract(0.0)


OPERATOR = {
    "thresholds": ChangeCollision(thresholds=tuple(LOW)),
    "soft": ChangeCollision(reaction="comply"),
}


@pytest.mark.parametrize("request_", OPERATOR.values(), ids=OPERATOR)
def test_an_operator_is_refused_thresholds_and_a_reaction(rig: TransportRig, request_: ChangeCollision) -> None:
    with pytest.raises(QRobotError, match=NO_TORQUES):
        set_collision(rig.mailbox, request_, ROBOT, torques_known=False)
    assert set_collision(rig.mailbox, ChangeCollision(), ROBOT, torques_known=False)


def test_a_log_of_such_an_arm_is_fitted_by_nobody(rig: TransportRig) -> None:
    rig.run_for(0.1)
    with pytest.raises(IdentificationError, match=NO_TORQUES):
        check_recording(ROBOT, rig.rows(), SETTINGS.period_ns * 1e-9)


def test_an_arm_with_such_drives_makes_no_moves_to_be_identified(tmp_path: Path) -> None:
    deployment = tmp_path / "drives.toml"
    deployment.write_text(DRIVES)
    for how in ("go", "lockstep"):
        with pytest.raises(ConfigError, match=NO_TORQUES):
            record(str(deployment), output=tmp_path / "run.mcap", **{how: True})
