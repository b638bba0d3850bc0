"""The picture of the page on runs off line: a path before it runs, with its setpoints and the limits of the joints.

Made by `python docs/planned_path_picture.py`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from qrobot import rccl
from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.log.plot import COLOURS, STYLE
from qrobot.motion import EventKind, PlannedPath, motion_limits
from qrobot.rccl.offline import OfflineLink
from qrobot.units import DEG_PER_RAD

PICTURE: Final = Path(__file__).parent / "images/planned_path.png"
DPI: Final = 100
TIMES: Final = 1000
JOINTS: Final = (0, 1, 2)
LABELS: Final = ("position (deg)", "velocity (deg/s)", "acceleration (deg/s2)")


def planned() -> tuple[Robot, PlannedPath]:
    """The path of a program that goes round a via point and back."""
    with rccl.use(OfflineLink), rccl.control() as arm:
        arm.setjvel(share=0.8)
        for name in ("ready", "end", "park"):
            arm.move(arm.pose(name))
        path = arm.plan()
        arm.stop()
        return arm.robot, path


def picture(robot: Robot, path: PlannedPath) -> Figure:
    """Position, velocity and acceleration of some joints, with the setpoints, and lines where a motion begins."""
    times = np.linspace(0.0, path.duration_s, TIMES)
    states, limits = path.table(times), motion_limits(robot)
    bounds: tuple[Floats | None, ...] = (None, limits.v_max, limits.a_max)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 7.2), layout="constrained")
        panels = figure.subplots(3, 1, sharex=True)
        for k, (axes, label, bound) in enumerate(zip(panels, LABELS, bounds, strict=True)):
            for j in JOINTS:
                line = {"color": COLOURS[j], "label": robot.joint_names[j]}
                axes.plot(times, DEG_PER_RAD * states[:, k, j], linewidth=1.2, **line)
                if bound is not None:
                    axes.axhline(DEG_PER_RAD * bound[j], color=COLOURS[j], linestyle=":", linewidth=0.8)
                    axes.axhline(-DEG_PER_RAD * bound[j], color=COLOURS[j], linestyle=":", linewidth=0.8)
            for t, event in path.events:
                if event.kind is EventKind.BEGUN and event.request is not None:
                    axes.axvline(t, color="0.6", linewidth=0.8)
                    if k == 0:
                        axes.annotate(event.request.name, (t, 1.0), xycoords=("data", "axes fraction"), va="bottom")
            axes.set_ylabel(label)
        for j in JOINTS:
            panels[0].plot(path.t, DEG_PER_RAD * path.q[:, j], ".", color=COLOURS[j], markersize=2.5)
        panels[0].legend(loc="center left", frameon=False)
        panels[2].set_xlabel("time from now (s)")
    return figure


if __name__ == "__main__":
    picture(*planned()).savefig(PICTURE, dpi=DPI)
