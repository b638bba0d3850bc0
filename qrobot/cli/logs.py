"""Logs as commands read them: with a word on what is missing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from qrobot.cli.console import note
from qrobot.errors import ConfigError, LogError
from qrobot.log.topics import part_beside

if TYPE_CHECKING:
    from qrobot.config import DeployedArm
    from qrobot.log.read import Log


def first_parts(files: Sequence[Path]) -> list[Path]:
    """One file for each log: a part that follows another one of them is left out.

    Raises ConfigError when there is no file.
    """
    if not files:
        raise ConfigError("name at least one log, such as out/puma560-*.mcap")
    return [file for file in files if _part_before(file) not in files]


def files_of_run(arm: DeployedArm, deployment: str, law: str | None = None, model: str | None = None) -> list[Path]:
    """Files that say what was chosen for a run: robot, deployment, the model and the law of a file, if there are any.

    `law` and `model` stand in front of those of the deployment file. Raises ConfigError when a file but that of the law
    is not there.
    """
    from qrobot.config import deployment_path, robot_path
    from qrobot.config.identified import model_path
    from qrobot.servo.laws.names import is_file_law, split_name

    law, model = law or arm.servo.law, model or arm.servo.model
    files = [robot_path(arm.robot), deployment_path(deployment)]
    files += [model_path(model)] if model else []
    law_file = Path(split_name(law)[0])
    return [*files, law_file] if is_file_law(law) and law_file.is_file() else files


def _part_before(file: Path) -> Path | None:
    """File of the part before, by what a later part of a log says of itself; None of a first one."""
    from qrobot.log.mcap_scan import header_of_part

    try:
        header = header_of_part(file)
    except LogError:
        return None
    return None if header is None or header.part == 1 else part_beside(file, header.part, header.part - 1)


def read_and_warn(path: Path) -> Log:
    """A log; what damage to its files has cost is told on stderr.

    Raises:
        LogError: as `read_log`, and when damage has left nothing of it.
    """
    from qrobot.log.read import read_log

    log = read_log(path)
    if log.lost and not log.rows.size:
        raise LogError(f"{path} is damaged, and no cycle can be read")
    for lost in log.lost:
        note(f"warning: {path} is damaged: {lost.line} are lost, the others are read")
    return log
