"""The picture of the tutorial on fences: how far off the bench each part of the arm is while the example runs.

Made by `python docs/fence_stop_picture.py`, off line.
"""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from qrobot import rccl
from qrobot.config import load_deployment, load_robot
from qrobot.fences.fence_set import FenceSet, fences_of
from qrobot.fences.in_force import use_fences
from qrobot.log.plot import COLOURS, STYLE
from qrobot.rccl.offline import OfflineLink
from qrobot.rccl.setpoints import Setpoints
from qrobot.rccl.trace import Trace
from qrobot.units import MM_PER_M

DOCS: Final = Path(__file__).parent
EXAMPLE: Final = DOCS.parent / "examples/19_fences.py"
PICTURE: Final = DOCS / "images/fence_stop.png"
DPI: Final = 100
BENCH: Final = 0  # of the fences


def fenced_run() -> tuple[FenceSet, Setpoints]:
    """The fences of the example, and the setpoints it asks for."""
    (arm,) = load_deployment(EXAMPLE.with_suffix(".toml")).arm
    fences, traces = fences_of(arm, load_robot(arm.robot)), list[Trace]()
    if fences is None:
        raise ValueError(f"{EXAMPLE} has no fences")
    with rccl.use(OfflineLink, traces), use_fences(fences):
        runpy.run_path(str(EXAMPLE), run_name="__main__")
    return fences, traces[0].setpoints


def stop_picture(fences: FenceSet, setpoints: Setpoints) -> Figure:
    """Distance from the bench over time, and the margin that motions keep."""
    off = MM_PER_M * np.array([fences.distances(q)[BENCH] for q in setpoints.q])
    margin, nearest = MM_PER_M * fences.margins[BENCH], int(off.argmin())
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.0, 3.8), layout="constrained")
        axes = figure.subplots()
        axes.plot(setpoints.t, off, color=COLOURS[0], linewidth=1.4)
        axes.axhspan(-15, 0, color=COLOURS[1], alpha=0.3)
        axes.axhline(margin, color=COLOURS[1], linestyle=":")
        axes.text(setpoints.t[1], margin + 4, "margin: motions keep so far off", color=COLOURS[1])
        axes.text(setpoints.t[1], -12, "bench", color=COLOURS[1])
        axes.plot(setpoints.t[nearest], off[nearest], "o", color=COLOURS[0])
        axes.annotate(f"FENCE: {off[nearest]:.1f} mm off", (setpoints.t[nearest], off[nearest]), xytext=(-40, 90),
                      textcoords="offset points", arrowprops={"arrowstyle": "->"})  # fmt: skip
        axes.set(xlabel="time (s)", ylabel="nearest part of the arm\noff the bench (mm)", ylim=(-15, None))
        axes.set_title("A lift sinks into a bench; the arm follows it up to the margin", pad=8)
    return figure


if __name__ == "__main__":
    stop_picture(*fenced_run()).savefig(PICTURE, dpi=DPI)
