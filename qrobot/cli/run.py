"""`qrobot run`: a robot program, against the bridge of a running arm or in lock-step without one."""

from __future__ import annotations

import os
import runpy
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, choose_arm, controlled_robot, robot_of_arm, servo_settings
from qrobot.config.scene import SceneKind
from qrobot.errors import ConfigError
from qrobot.units import US_PER_MS

if TYPE_CHECKING:
    from qrobot.config.deployment import Arm
    from qrobot.rci import LinkFactory


def run(
    program: Path,
    *arguments: Annotated[str, Parameter(allow_leading_hyphen=True)],
    deployment: str = DEFAULT_DEPLOYMENT,
    arm: str | None = None,
    lockstep: bool = False,
    offline: bool = False,
    output: Path | None = None,
    plant: Literal["nominal", "mismatched"] | None = None,
    scene: SceneKind | None = None,
) -> int:
    """Run a program that moves an arm through `qrobot.rccl`: a script in Python, or what `qrobot cc` made of one in C.

    The program is an ordinary one; it finds the arm by itself. With --lockstep it needs no running arm: an emulated
    one runs inside this process on virtual time, the same way every time, and as fast as the machine allows. With
    --offline there is no servo and no board either: an ideal arm follows every setpoint, and what the program asked for
    and sent is written down: a trace of its requests, a setpoint file for `qrobot replay`, figures of joints and path.
    With --output that is done for the other kinds of run too; the path then has the measured one beside it.

      qrobot run examples/01_park_and_return.py
      qrobot run --lockstep examples/01_park_and_return.py
      qrobot run --offline examples/02_four_corners.py
      qrobot run --output out/box examples/12_box.py
      qrobot run --offline ./four_corners

    Parameters
    ----------
    program
        Path of the script, or of the executable.
    arguments
        Its own command-line arguments.
    deployment
        Deployment file, or the name of a packaged one: tells where the bridge is.
    arm
        Which arm of the file; may be left out when there is only one.
    lockstep
        On virtual time, without processes.
    offline
        On virtual time, without a servo.
    output
        Folder for what is written down; default with --offline out/offline/ and the program's name, else nothing is.
    plant
        With --lockstep: overrides the deployment file.
    scene
        With --lockstep: overrides the deployment file: what stands around the arm.
    """
    if not program.is_file():
        raise ConfigError(f"no program {program}")
    if program.suffix == ".c":
        raise ConfigError(
            f"{program} is a source: compile it with `qrobot cc {program} -o {program.stem}`, and run that"
        )
    if offline and (lockstep or plant is not None or scene is not None):
        raise ConfigError("--offline knows no board: leave out --lockstep, --plant and --scene")
    chosen = choose_arm(deployment, arm)
    start = partial(_start, program, arguments, chosen.robot)
    if offline:
        factory, output = _offline_links(chosen), output or Path("out") / "offline" / program.stem
    else:
        factory = _lockstep_links(chosen, plant, scene) if lockstep else _bridge_links(chosen)
    if output is not None:
        from qrobot.cli.traced import run_traced

        return run_traced(start, factory, output, ideal=offline)
    from qrobot import rccl
    from qrobot.realtime.interrupt import heed_interrupts

    with rccl.use(factory), heed_interrupts() if lockstep else nullcontext():
        return start()


def _start(program: Path, arguments: Sequence[str], robot: str) -> int:
    """Run the program; its exit status. One in C does not say itself which robot it wants."""
    from qrobot.rccl.c.program import is_executable, run_executable

    if is_executable(program):
        return run_executable(program, arguments, robot)
    sys.argv = [str(program), *arguments]
    sys.path.insert(0, str(program.resolve().parent))
    runpy.run_path(str(program), run_name="__main__")
    return 0


def _bridge_links(arm: Arm) -> LinkFactory:
    """To the arm of the deployment file, unless the environment names another bridge."""
    from qrobot.rci import TcpLink, bridge_address
    from qrobot.realtime.turn import await_turn

    await_turn()
    os.environ.setdefault("QROBOT_BRIDGE", f"{arm.bridge.host}:{arm.bridge.port}")
    return lambda hello: TcpLink(hello, bridge_address())


def _lockstep_links(arm: Arm, plant: Literal["nominal", "mismatched"] | None, scene: SceneKind | None) -> LinkFactory:
    from qrobot.rig.lockstep import LockstepRig, link_factory
    from qrobot.sim_board.deployed import emulator_of_arm

    robot = robot_of_arm(arm)
    emulator = emulator_of_arm(arm, robot, plant=plant, scene=scene)
    rig = LockstepRig(controlled_robot(arm)[0], servo_settings(arm), emulator, keep_telemetry=False)
    return partial(link_factory, rig, round(arm.bridge.period_ms * US_PER_MS))


def _offline_links(arm: Arm) -> LinkFactory:
    """To an ideal arm as in the deployment file; a program that names another packaged one gets that."""
    from qrobot.rccl.offline import OfflineLink

    robot, period_us = robot_of_arm(arm), round(arm.bridge.period_ms * US_PER_MS)
    return lambda hello: OfflineLink(hello, robot if hello.robot == robot.name else None, period_us=period_us)
