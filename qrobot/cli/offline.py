"""A program without a robot, and what is written down about it."""

from __future__ import annotations

import runpy
from functools import partial
from pathlib import Path

from qrobot import rccl
from qrobot.cli.console import note, out
from qrobot.cli.motion_figures import joints_figure, path_figure
from qrobot.config import Robot
from qrobot.errors import ConfigError
from qrobot.log.plot import save_figure
from qrobot.rccl.offline import OfflineLink
from qrobot.rccl.setpoints import write_setpoints
from qrobot.rccl.trace import Trace
from qrobot.rci import Link
from qrobot.wire import Hello


def run_offline(program: Path, robot: Robot, period_us: int, folder: Path) -> None:
    """Run a program on an ideal arm and write its traces, also those of a program that fails.

    Args:
        program: the script.
        robot: the arm of the deployment file; a program that names another packaged one gets that.
        period_us: sample period where the program asks for none.
        folder: for the files.
    """
    traces: list[Trace] = []
    try:
        with rccl.use(partial(_link, robot, period_us), traces):
            try:
                runpy.run_path(str(program), run_name="__main__")
            finally:
                rccl.release()
    finally:
        for number, trace in enumerate(traces, 1):
            write_trace(trace, folder, "" if number == 1 else f"-{number}")


def _link(robot: Robot, period_us: int, hello: Hello) -> Link:
    return OfflineLink(hello, robot if hello.robot == robot.name else None, period_us=period_us)


def write_trace(trace: Trace, folder: Path, suffix: str = "") -> None:
    """Write requests as text and JSON lines, setpoints, and figures. Raises ConfigError, LogError when that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"requests{suffix}.txt").write_text(trace.text())
        (folder / f"requests{suffix}.jsonl").write_text(trace.json_lines())
    except OSError as error:
        raise ConfigError(f"cannot write into {folder}: {error.strerror}") from error
    out.print(trace.text(), end="", highlight=False, markup=False, soft_wrap=True)
    setpoints = trace.setpoints
    if not len(setpoints.q):
        return
    write_setpoints(folder / f"setpoints{suffix}.csv", setpoints)
    save_figure(joints_figure(trace.robot, setpoints), folder / f"joints{suffix}.png")
    save_figure(path_figure(trace.robot, setpoints), folder / f"path{suffix}.png")
    note(f"{len(setpoints.q)} setpoints, the requests and two figures are in {folder}")
