"""`qrobot run`: a robot program, against the bridge of a running arm or in lock-step without one."""

from __future__ import annotations

import os
import runpy
import sys
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, choose_arm, robot_of_arm, servo_settings
from qrobot.config.scene import SceneKind
from qrobot.errors import ConfigError

US_PER_MS = 1000


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
) -> None:
    """Run a Python program that moves an arm through `qrobot.rccl`.

    The program is an ordinary script; it finds the arm by itself. With --lockstep it needs no running arm: an emulated
    one runs inside this process on virtual time, the same way every time, and as fast as the machine allows. With
    --offline there is no servo and no board either: an ideal arm follows every setpoint, and what the program asked for
    and sent is written down: a trace of its requests, a setpoint file for `qrobot replay`, figures of joints and path.

      qrobot run examples/01_park_and_return.py
      qrobot run --lockstep examples/01_park_and_return.py
      qrobot run --offline examples/02_four_corners.py

    Parameters
    ----------
    program
        Path of the script.
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
        With --offline: the folder for what is written; default out/offline/ and the program's name.
    plant
        With --lockstep: overrides the deployment file.
    scene
        With --lockstep: overrides the deployment file: what stands around the arm.
    """
    if not program.is_file():
        raise ConfigError(f"no program {program}")
    if offline and (lockstep or plant is not None or scene is not None):
        raise ConfigError("--offline knows no board: leave out --lockstep, --plant and --scene")
    if output is not None and not offline:
        raise ConfigError("--output belongs to --offline")
    chosen = choose_arm(deployment, arm)
    sys.argv = [str(program), *arguments]
    sys.path.insert(0, str(program.resolve().parent))
    if offline:
        from qrobot.cli.offline import run_offline

        folder = output or Path("out") / "offline" / program.stem
        run_offline(program, robot_of_arm(chosen), round(chosen.bridge.period_ms * US_PER_MS), folder)
        return
    if not lockstep:
        os.environ.setdefault("QROBOT_BRIDGE", f"{chosen.bridge.host}:{chosen.bridge.port}")
        runpy.run_path(str(program), run_name="__main__")
        return

    from qrobot import rccl
    from qrobot.rig.lockstep import LockstepRig, link_factory
    from qrobot.sim_board.deployed import emulator_of_arm

    robot = robot_of_arm(chosen)
    emulator = emulator_of_arm(chosen, robot, plant=plant, scene=scene)
    rig = LockstepRig(robot, servo_settings(chosen), emulator, keep_telemetry=False)
    with rccl.use(partial(link_factory, rig, round(chosen.bridge.period_ms * US_PER_MS))):
        runpy.run_path(str(program), run_name="__main__")
