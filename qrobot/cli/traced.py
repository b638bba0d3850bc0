"""A program is run, and what it did is written down: requests, setpoints, and figures of joints and path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

from qrobot import rccl
from qrobot.cli.console import note, out
from qrobot.errors import ConfigError
from qrobot.rccl.setpoints import write_setpoints
from qrobot.rccl.trace import Trace
from qrobot.rci import LinkFactory

FIGURED: Final = 10_000  # [A] samples in the figures: their end of a run of weeks is drawn in seconds


def run_traced(program: Callable[[], int], factory: LinkFactory, folder: Path, ideal: bool) -> int:
    """Run a program and write its traces, also those of a program that fails; its exit status.

    Args:
        program: runs it.
        factory: makes its link to the arm.
        folder: for the files.
        ideal: the arm only exists on paper, so nothing of it is measured.
    """
    traces: list[Trace] = []
    try:
        with rccl.use(factory, traces):
            try:
                return program()
            finally:
                rccl.release()
    finally:
        for number, trace in enumerate([trace for trace in traces if trace.requests] or traces[:1], 1):
            _write_trace(trace, folder, "" if number == 1 else f"-{number}", ideal)


def _write_trace(trace: Trace, folder: Path, suffix: str, ideal: bool) -> None:
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
    if trace.begin_s:
        note(f"the setpoints before {trace.begin_s:.3f} s are not kept: those in the file begin there")
    _write_figures(trace, folder, suffix, ideal)
    note(f"{len(setpoints.q)} setpoints, the requests and two figures are in {folder}")


def _write_figures(trace: Trace, folder: Path, suffix: str, ideal: bool) -> None:
    """Joints and path of the newest FIGURED samples, and how far the measured path is off the one asked for."""
    from qrobot.cli.motion_figures import NEAR, farthest_off, joints_figure, path_figure, path_of
    from qrobot.log.plot import save_figure  # here, for Matplotlib takes a second: no program waits for it to begin

    setpoints = trace.setpoints
    shown = replace(setpoints, q=setpoints.q[-FIGURED:])
    if len(shown.q) < len(setpoints.q):
        note(f"the figures show the last {shown.t[-1]:.0f} s")
    asked = path_of(trace.robot, shown.q)
    measured = None if ideal else path_of(trace.robot, trace.measured[-FIGURED:])
    save_figure(joints_figure(trace.robot, shown), folder / f"joints{suffix}.png")
    save_figure(path_figure(trace.robot.name, asked, measured), folder / f"path{suffix}.png")
    if measured is not None:
        note(f"the measured way is at most {farthest_off(asked, measured, NEAR):.2f} mm off the one asked for")
