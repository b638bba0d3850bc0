"""Everything compiled that runs for an arm of a deployment file, and in a program that moves it.

A first start does the same while somebody waits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from qrobot.config import Robot
from qrobot.config.deployment import DeployedArm
from qrobot.rccl.connect import compile_motion
from qrobot.rccl_bridge import mailbox_port
from qrobot.rig.compile_ahead import compiled_beside
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.process import daemon, guardian
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board import server
from qrobot.sim_board.deployed import emulator_of_arm

CompileStep = tuple[str, Callable[[], Any]]  # what is compiled, and what does it


def stages(arm: DeployedArm, robot: Robot, settings: ServoSettings) -> Iterator[CompileStep]:
    """Steps of compiling for one arm, one after another; the emulated board where the arm has one.

    Raises:
        ConfigError: what `emulator_of_arm` raises; the calls raise the same of the law.
    """
    if arm.board.emulated:
        emulator = emulator_of_arm(arm, robot)
        yield (
            "servo and emulated board in lock-step",
            lambda: _compile_loop(arm.robot, LockstepRig(robot, settings, emulator)),
        )
        yield "emulated board", lambda: server.warm_up(emulator)
    yield "servo", lambda: daemon.warm_up(robot, settings)
    yield "guardian", guardian.warm_up
    yield "bridge", mailbox_port.warm_up
    yield "what a program moves by", lambda: compile_motion(arm.robot)


def _compile_loop(file: str, rig: LockstepRig) -> None:
    with compiled_beside(file) as compile_loop:
        compile_loop(rig)
