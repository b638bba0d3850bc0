"""How long a start takes, with everything compiled and with nothing compiled yet."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Final

from benchmarks.rows import Goal, Row, against, row
from benchmarks.timing import Effort, interleaved, seconds

ROOT: Final = Path(__file__).parents[1]
RIG: Final = (
    "from qrobot.config import load_robot; from qrobot.rig.lockstep import LockstepRig; "
    "from qrobot.servo.settings import ServoSettings; "
    "LockstepRig(load_robot('puma560'), ServoSettings(rate_hz=4000)).ticks(1)"
)
FIRST_PROGRAM: Final = ("-m", "qrobot", "run", "--lockstep", "examples/01_park_and_return.py")
COMMAND: Final = ("-m", "qrobot", "ctl", "--help")  # everything that `ctl stop` imports before it looks for a servo
LIBRARIES: Final = "import cyclopts, numpy, pydantic, rich.console, rich.table"  # what such a command cannot do without
# What Numba takes on this machine, whatever we do; the servo has three times as many functions.
NUMBA_ALONE: Final = (
    "from numba import njit; made = [njit('f8(f8[:])')(eval(f'lambda x: x[0] * {k} + x[1]')) for k in range(100)]"
)


def start(program: tuple[str, ...], cache: Path | None = None) -> None:
    """Run one short-lived interpreter, with compiled code kept in `cache` instead of the usual place."""
    environment = dict(os.environ)
    if cache is not None:
        environment |= {"NUMBA_CACHE_DIR": str(cache / "numba"), "QROBOT_CACHE": str(cache / "qrobot")}
    subprocess.run([sys.executable, *program], env=environment, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)


def rows(effort: Effort) -> Iterator[Row]:
    """The rows."""
    rig, program = ("-c", RIG), ("-m", "qrobot", "--help")
    start(rig)
    starts = {"rig": rig, "help": program, "command": COMMAND, "libraries": ("-c", LIBRARIES)}
    warm = interleaved({name: partial(start, words) for name, words in starts.items()}, effort.rounds)
    yield row("start of servo, board and plant, compiled before", warm["rig"], "s")
    yield row("`qrobot --help`", warm["help"], "s")
    yield against(
        "`qrobot ctl`, up to its help", warm["command"], "s", "its libraries", warm["libraries"], Goal(2.5, "ratio")
    )
    if effort.cold:
        with tempfile.TemporaryDirectory() as folder:
            cold = seconds(lambda: start(rig, Path(folder)))
        yield row("first start of servo, board and plant, with all there is to compile", cold, "s")
        with tempfile.TemporaryDirectory() as folder:
            everything = ("--output", folder)
            first = seconds(lambda: start((*FIRST_PROGRAM, *everything), Path(folder)))
        alone = seconds(lambda: start(("-c", NUMBA_ALONE)))
        name = "first program in lock-step to its end, with all there is to compile"
        yield against(name, first, "s", "Numba alone, 100 small functions", alone, Goal(15.0))
