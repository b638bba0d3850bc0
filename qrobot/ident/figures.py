"""Figures of an identification: measured torque against predicted, and what is left over the time of the recording."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from qrobot.arrays import Floats
from qrobot.ident.fit import OUTLIER
from qrobot.ident.model import Identified
from qrobot.log.plot import COLOURS, STYLE

COLUMNS: Final = 3
OLD, NEW, ODD = COLOURS[4], COLOURS[0], COLOURS[1]
_PANEL: Final = (3.2, 2.7)  # inches


def predicted_figure(found: Identified) -> Figure:
    """Measured torque of each pass over the predicted one, of robot file and model; a panel for each motor."""
    seen, unknowns = found.observations, found.unknowns
    before, now = unknowns.predict(unknowns.before(), seen), unknowns.predict(found.fit.values, seen)

    def draw(axes: Axes, mine: NDArray[np.bool_]) -> None:
        ends = [float(seen.torque[mine].min()), float(seen.torque[mine].max())]
        axes.plot(ends, ends, color="#888888", linewidth=0.8)
        axes.plot(before[mine], seen.torque[mine], "x", color=OLD, markersize=4, label="robot file")
        axes.plot(now[mine], seen.torque[mine], ".", color=NEW, markersize=5, label="identified")

    return _panels(found, draw, ("predicted, N m (N)", "measured, N m (N)"), "Measured against predicted torque")


def residuals_figure(found: Identified) -> Figure:
    """Measured less fitted torque over the time of the recording, outliers marked: what drifts shows here."""
    seen, left = found.observations, residual(found)
    odd = np.zeros(len(seen), np.bool_)
    odd[found.fit.outliers] = True

    def draw(axes: Axes, mine: NDArray[np.bool_]) -> None:
        axes.axhline(0.0, color="#888888", linewidth=0.8)
        axes.plot(seen.time_s[mine & ~odd], left[mine & ~odd], ".", color=NEW, markersize=5, label="passes")
        label = f"more than {OUTLIER:.0f} deviations off"
        axes.plot(seen.time_s[mine & odd], left[mine & odd], "x", color=ODD, markersize=5, label=label)

    return _panels(found, draw, ("time, s", "left over, N m (N)"), "What the fit leaves of each pass")


def structure_figure(found: Identified) -> Figure:
    """Residuals beside viscous and Coulomb friction over position, speed and load, and the terms found in them."""
    seen, unknowns, robot = found.observations, found.unknowns, found.robot
    of_terms = unknowns.term_columns(seen) @ unknowns.parts(found.fit.values).terms
    plain, motor_q = residual(found) + of_terms, seen.q @ robot.transmission.coupling.T
    coulomb = np.maximum(np.abs(found.friction[:, 1:]).mean(axis=1), 1e-9)
    borne = np.abs(unknowns.weights(seen) @ unknowns.parts(found.fit.values).weights)
    style: dict[Any, Any] = STYLE | {"axes.titlepad": 6.0, "axes.titlesize": 10.0}
    with mpl.rc_context(style):
        figure = Figure(figsize=(3 * _PANEL[0], robot.n * 1.7 + 0.8), layout="constrained")
        panels = figure.subplots(robot.n, 3, squeeze=False)
        for motor, row in enumerate(panels):
            mine = seen.motor == motor
            along = np.sign(seen.rate[mine]) * 100.0 / coulomb[motor]
            over = motor_q[mine, motor], np.abs(seen.rate[mine]), borne[mine]
            for axes, x in zip(row, over, strict=True):
                axes.axhline(0.0, color="#888888", linewidth=0.8)
                rings = axes.plot(x, along * of_terms[mine], "o", color=ODD, markersize=6, label="fitted beside them")
                rings[0].set_markerfacecolor("none")
                axes.plot(x, along * plain[mine], ".", color=NEW, markersize=4, label="left by viscous and Coulomb")
            row[0].set_title(robot.joint_names[motor].replace("_", " "))
        for axes, name in zip(
            panels[-1], ("motor angle, rad (m)", "speed, rad/s (m/s)", "gravity, N m (N)"), strict=True
        ):
            axes.set_xlabel(name)
        figure.suptitle("Friction beside viscous and Coulomb: structure in position, speed and load", fontweight="bold")
        figure.supylabel("against the motion, % of Coulomb friction", fontsize=10)
        handles, names = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower right", ncols=2, frameon=False)
    return figure


def residual(found: Identified) -> Floats:
    """Measured less fitted torque of each observation. Shape (m,)."""
    seen = found.observations
    return np.asarray(seen.torque - found.unknowns.predict(found.fit.values, seen))


def _panels(
    found: Identified, draw: Callable[[Axes, NDArray[np.bool_]], None], labels: tuple[str, str], title: str
) -> Figure:
    """One panel for each motor, filled by `draw` with the observations that are its own."""
    n = found.robot.n
    rows = -(-n // COLUMNS)
    style: dict[Any, Any] = STYLE | {"axes.titlepad": 6.0, "axes.titlesize": 10.0}
    with mpl.rc_context(style):
        figure = Figure(figsize=(COLUMNS * _PANEL[0], rows * _PANEL[1] + 0.6), layout="constrained")
        panels = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
        for motor, axes in enumerate(panels[:n]):
            if (mine := found.observations.motor == motor).any():
                draw(axes, mine)
            axes.set_title(found.robot.joint_names[motor].replace("_", " "))
        for axes in panels[n:]:
            axes.set_visible(False)
        figure.suptitle(title, fontweight="bold")
        figure.supxlabel(labels[0], fontsize=10)
        figure.supylabel(labels[1], fontsize=10)
        handles, names = panels[int(np.bincount(found.observations.motor).argmax())].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower right", ncols=2, frameon=False)
    return figure
