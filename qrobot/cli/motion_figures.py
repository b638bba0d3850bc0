"""Figures of setpoints: the joints over time, and the way of the last link in space."""

from __future__ import annotations

from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from qrobot.config import Robot
from qrobot.log.plot import COLOURS, DASHES, LEGEND, STYLE
from qrobot.model.arm import Arm
from qrobot.motion.limits import Floats
from qrobot.rccl.setpoints import Setpoints
from qrobot.units import DEG_PER_RAD, MM_PER_M

_PROJECTIONS: Final = ((1, "x", "y"), (2, "x", "z"), (3, "y", "z"))  # place in the figure, axes
_AXIS: Final = {"x": 0, "y": 1, "z": 2}


def joints_figure(robot: Robot, setpoints: Setpoints) -> Figure:
    """One line per joint over time, degrees; sliding joints, if there are any, in mm on an axis of their own."""
    kinds = [
        (~robot.prismatic, DEG_PER_RAD, "joint position (deg)"),
        (robot.prismatic, MM_PER_M, "joint position (mm)"),
    ]
    panels = [kind for kind in kinds if kind[0].any()]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 1.4 + 3.2 * len(panels)), layout="constrained")
        for axes, (chosen, scale, label) in zip(
            figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0], panels, strict=True
        ):
            for j in np.flatnonzero(chosen):
                line = {"color": COLOURS[j % len(COLOURS)], "linestyle": DASHES[j // len(COLOURS) % len(DASHES)]}
                axes.plot(setpoints.t, setpoints.q[:, j] * scale, label=robot.joint_names[j], **line)
            axes.set(ylabel=label, xlabel="time (s)")
            axes.legend(**LEGEND)
        figure.suptitle(f"Setpoints of {robot.name}")
    return figure


def path_figure(robot: Robot, setpoints: Setpoints) -> Figure:
    """The origin of T6 in the base frame, mm: in three projections and in space."""
    path = path_of(robot, setpoints.q)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 8.0), layout="constrained")
        for place, across, up in _PROJECTIONS:
            axes: Any = figure.add_subplot(2, 2, place, aspect="equal", adjustable="datalim")
            axes.plot(path[:, _AXIS[across]], path[:, _AXIS[up]], color=COLOURS[0])
            axes.plot(path[0, _AXIS[across]], path[0, _AXIS[up]], "o", color=COLOURS[1], label="start")
            axes.set(xlabel=f"{across} (mm)", ylabel=f"{up} (mm)")
        space: Any = figure.add_subplot(2, 2, 4, projection="3d")
        space.plot(*path.T, color=COLOURS[0])
        space.plot(*path[:1].T, "o", color=COLOURS[1])
        space.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="z (mm)")
        figure.suptitle(f"Way of {robot.name}'s last link (the dot is the start)")
    return figure


def path_of(robot: Robot, q: Floats) -> Floats:
    """Origin of T6 at joint positions `q` (samples, n), mm. Shape (samples, 3)."""
    arm = Arm(robot)
    return MM_PER_M * np.array([arm.forward(row)[:3, 3] for row in q])
