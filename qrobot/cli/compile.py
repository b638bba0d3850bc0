"""`qrobot compile`: compile before anybody waits for it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from qrobot.cli.console import note, out, write_json
from qrobot.errors import ConfigError

if TYPE_CHECKING:
    from qrobot.config.deployment import DeployedArm


def compile(deployment: str = "emulator", *, json: bool = False) -> None:
    """Compile what the arms of a deployment file need, so that no start has to wait for it.

    At installation, for an image, or for all accounts of a machine: code is kept beside the installed package, or in
    NUMBA_CACHE_DIR if that is set. Who may only read that folder uses what is in it; what it lacks, a law of one's own
    for example, is compiled at its first use and kept in ~/.cache/numba. Code is for one kind of processor and for the
    installed versions of Python, Numba and QRobot; whatever does not fit is compiled anew.

    Parameters
    ----------
    deployment
        Deployment file, or the name of a packaged one, whose arms are looked at.
    json
        Print JSON.
    """
    from qrobot.config import load_deployment
    from qrobot.realtime.compiled_files import USED_FOLDERS
    from qrobot.realtime.jit import jit_disabled

    if jit_disabled():
        raise ConfigError("NUMBA_DISABLE_JIT is set, so that nothing would be compiled: unset it")
    for arm in load_deployment(deployment).arm:
        _compile_arm(arm)
    if not USED_FOLDERS:
        raise ConfigError("compiled code cannot be kept: set NUMBA_CACHE_DIR to a folder that can be written")
    _tell(USED_FOLDERS, json)


def _compile_arm(arm: DeployedArm) -> None:
    from qrobot.cli.arms import controlled_robot
    from qrobot.cli.servo_settings import servo_settings
    from qrobot.rig.compile_everything import stages

    robot, _ = controlled_robot(arm)
    for name, perform in stages(arm, robot, servo_settings(arm)):
        note(f"{arm.name}: {name}")
        perform()


def _tell(used: dict[str, set[str]], json: bool) -> None:
    """Folders, and how many programs of machine code there are for this deployment."""
    programs, folder = sum(map(len, used.values())), common_folder(used)
    if json:
        write_json({"programs": programs, "folder": folder, "folders": _counted(used)})
    else:
        out.print(f"{programs} programs of machine code in {folder}", soft_wrap=True)


def common_folder(used: dict[str, set[str]]) -> str:
    """The folder above all folders of compiled code, and the one itself where there is one only."""
    return os.path.commonpath(Path(folder).parent if len(used) > 1 else folder for folder in used)


def _counted(used: dict[str, set[str]]) -> dict[str, Any]:
    return {folder: len(names) for folder, names in sorted(used.items())}
