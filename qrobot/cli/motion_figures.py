"""Figures of a motion: the joints over time, and the way of the last link in space."""

from __future__ import annotations

from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.log.plot import COLOURS, DASHES, LEGEND, STYLE
from qrobot.model.arm import Arm
from qrobot.rccl.setpoints import Setpoints
from qrobot.units import DEG_PER_RAD, MM_PER_M

NEAR: Final = 250  # [A] samples by which a place may lie before or behind the one asked for: 7 s at 28 ms
_PROJECTIONS: Final = ((1, "x", "y"), (2, "x", "z"), (3, "y", "z"))  # place in the figure, axes
_AXIS: Final = {"x": 0, "y": 1, "z": 2}
WIDE: Final = {"color": COLOURS[0], "linewidth": 3.0, "alpha": 0.4}
THINNEST, WIDER = 1.2, 0.4  # each line is wider than the one above it: joints that move alike are all seen
THIN: Final = {"color": COLOURS[1], "linewidth": 1.0}


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
            joints = np.flatnonzero(chosen)
            for j, above in zip(joints, reversed(range(joints.size)), strict=True):
                line: dict[str, Any] = {
                    "color": COLOURS[j % len(COLOURS)],
                    "linestyle": DASHES[j // len(COLOURS) % len(DASHES)],
                }
                line |= {"linewidth": THINNEST + above * WIDER}
                axes.plot(setpoints.t, setpoints.q[:, j] * scale, label=robot.joint_names[j], **line)
            axes.set(ylabel=label, xlabel="time (s)")
            axes.legend(**LEGEND)
        figure.suptitle(f"Setpoints of {robot.name}")
    return figure


def path_figure(name: str, asked: Floats, measured: Floats | None = None) -> Figure:
    """The way of the last link in the base frame, mm: in three projections and in space.

    Args:
        name: of the arm.
        asked: its setpoints. Shape (samples, 3).
        measured: where it was. Shape (samples, 3).
    """
    ways = [(asked, "asked", WIDE)] if measured is None else [(asked, "asked", WIDE), (measured, "measured", THIN)]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 8.0), layout="constrained")
        for place, across, up in _PROJECTIONS:
            axes: Any = figure.add_subplot(2, 2, place, aspect="equal", adjustable="datalim")
            for way, label, line in ways:
                axes.plot(way[:, _AXIS[across]], way[:, _AXIS[up]], label=label, **line)
            axes.plot(asked[0, _AXIS[across]], asked[0, _AXIS[up]], "o", color=COLOURS[1])
            axes.set(xlabel=f"{across} (mm)", ylabel=f"{up} (mm)")
        space: Any = figure.add_subplot(2, 2, 4, projection="3d")
        for way, label, line in ways:
            space.plot(*way.T, label=label, **line)
        space.plot(*asked[:1].T, "o", color=COLOURS[1])
        space.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="z (mm)", aspect="equal")
        space.set_box_aspect(None, zoom=0.85)  # else the label of z is cut off
        space.locator_params(nbins=4)
        if measured is not None:
            space.legend(loc="upper right")
        figure.suptitle(f"Way of {name}'s last link (the dot is the start)")
    return figure


def path_of(robot: Robot, q: Floats) -> Floats:
    """Origin of T6 at joint positions `q` (samples, n), mm. Shape (samples, 3)."""
    arm = Arm(robot)
    return MM_PER_M * np.array([arm.forward(row)[:3, 3] for row in q])


def farthest_off(asked: Floats, measured: Floats, near: int | None = None) -> float:
    """The largest distance of a place of `measured` (k, 3) from the way through the places of `asked` (m, 3).

    With `near` they are of the same samples, and the way is that of so many samples before and behind each place: of a
    long one the whole takes too long.
    """
    along = np.diff(asked, axis=0, prepend=asked[:1])  # to each place from the one before
    begin = asked - along
    square = np.maximum(np.square(along).sum(axis=1), np.finfo(np.float64).tiny)
    whole = slice(None)
    ways = (whole if near is None else slice(max(0, k - near), k + near + 1) for k in range(len(measured)))
    return max(_distance(place, begin[way], along[way], square[way]) for place, way in zip(measured, ways, strict=True))


def _distance(place: Floats, begin: Floats, along: Floats, square: Floats) -> float:
    """Distance of one place (3,) from the nearest of the pieces `begin` + s `along`, 0 <= s <= 1. Shapes (m, 3)."""
    s = np.clip(((place - begin) * along).sum(axis=1) / square, 0.0, 1.0)
    return float(np.linalg.norm(begin + s[:, None] * along - place, axis=1).min())
