"""`qrobot up`: everything a deployment file names, started in order and watched until Ctrl-C."""

from __future__ import annotations

import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, robot_of_arm, servo_settings
from qrobot.cli.console import SUCCESS, note
from qrobot.errors import LinkLost

if TYPE_CHECKING:
    from qrobot.rig.processes import ProcessRig

POLL_S = 0.2


def up(deployment: str = DEFAULT_DEPLOYMENT, *, out_dir: Path = Path("out/processes")) -> int:
    """Start board, servo, guardian, bridge and log of every arm of a deployment file; end them with Ctrl-C.

    Programs then reach the arms through their bridges (`qrobot run PROGRAM`). When one of the processes dies the others
    are ended in good order: the servo stops the arm first.

    Parameters
    ----------
    deployment
        Deployment file, or the name of a packaged one (emulator, pressing, two_arms).
    out_dir
        Where the processes' messages go, one file each.
    """
    from qrobot.config.deployment import load_deployment
    from qrobot.rig.deployed import ArmProcesses, require_free_port
    from qrobot.rig.processes import ProcessRig

    arms = load_deployment(deployment).arm
    for arm in arms:  # what is wrong with the last arm is told before the first one starts
        robot_of_arm(arm)
        servo_settings(arm)
        require_free_port(arm)
    with ProcessRig(out_dir) as rig:
        for arm in arms:
            note(f"starting {arm.name} (a first start compiles for a minute or two)")
            ArmProcesses(rig, deployment, arm).start_all()
            note(f"{arm.name} is up: programs reach it at {arm.bridge.host}:{arm.bridge.port}")
        note("Ctrl-C ends everything")
        with suppress(KeyboardInterrupt):
            _watch(rig)
        note("stopping")
    return SUCCESS


def _watch(rig: ProcessRig) -> None:
    """Return never; raise LinkLost when a process has ended that nobody asked to."""
    while True:
        time.sleep(POLL_S)
        if dead := rig.first_dead():
            raise LinkLost(f"{dead.name} has ended: {dead.complaint()}")
