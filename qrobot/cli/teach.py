"""`qrobot teach`: an arm moved by commands, from a terminal or a script."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, choose_arm, inside_fences
from qrobot.cli.console import out
from qrobot.cli.option_types import OutputFile
from qrobot.errors import ConfigError, LinkError, MotionError, QRobotError, ServoFault, error_text
from qrobot.realtime.signals import ends_as_ctrl_c

if TYPE_CHECKING:
    from qrobot.rccl.teach import Teacher

PROMPT = "? "


@ends_as_ctrl_c()
def teach(
    database: OutputFile = Path("taught.db"),
    *,
    script: Path | None = None,
    offline: bool = False,
    deployment: str = DEFAULT_DEPLOYMENT,
    arm: str | None = None,
) -> None:
    """Move an arm by commands in world or tool coordinates, and record where it is into a transform data base.

    Type help for the commands. Mistakes, and motions that cannot be done, are told and end nothing; the first one ends
    a script. What was recorded is for programs: DataBase(path).get(name) of the library.

      qrobot teach parts.db
      echo "world dz -20" | qrobot teach --offline

    Parameters
    ----------
    database
        The file; it need not exist yet.
    script
        Read commands from this file instead of the terminal.
    offline
        On an ideal arm inside this process, on virtual time.
    deployment
        Deployment file, or the name of a packaged one: tells where the bridge is.
    arm
        Which arm of the file; may be left out when there is only one.
    """
    from qrobot.cli.arm_links import link_of
    from qrobot.rccl.connect import open_channel
    from qrobot.rccl.database import DataBase
    from qrobot.rccl.teach import Teacher

    lines = _typed() if script is None else iter(_script(script))
    taught = DataBase(database)
    taught.check()  # better now than when the arm is in place
    chosen = choose_arm(deployment, arm)
    with inside_fences(chosen), open_channel(link_of(chosen, offline), chosen.robot) as channel:
        teacher = Teacher(channel, taught)
        reads_answers = script is None and sys.stdin.isatty()
        for number, line in enumerate(lines, 1):
            if answer := teacher.obey(line) if reads_answers else _carried_out(teacher, line, number):
                out.print(answer, markup=False, soft_wrap=True)
            if teacher.over:
                break


def _carried_out(teacher: Teacher, line: str, number: int) -> str:
    """Answer to a line of a script, whose next ones count on it. Raises QRobotError: it could not be done."""
    try:
        return teacher.carry_out(line)
    except (LinkError, ServoFault):
        raise
    except QRobotError as error:
        raise MotionError(f"line {number}, {line.strip()!r}: {error}; nothing behind it was done") from error


def _typed() -> Iterator[str]:
    """Lines of the terminal, or of what stands before the pipe."""
    try:
        while True:
            yield input(PROMPT if sys.stdin.isatty() else "")
    except EOFError:
        return


def _script(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot read {path}: {error_text(error)}") from error
