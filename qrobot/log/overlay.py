"""The figure of two logs: their motions over each other, and below joint by joint how each was tracked."""

from __future__ import annotations

from typing import Any, Final

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from qrobot.log.compare import LogComparison, tracking_time
from qrobot.log.plot import COLOURS, STYLE, thin
from qrobot.log.read import Log

COLUMNS: Final = 3
ROW_INCHES: Final = 1.9
LOOKS: Final[tuple[dict[str, Any], ...]] = (
    {"color": COLOURS[0], "linewidth": 1.0},
    {"color": COLOURS[1], "linewidth": 1.0, "alpha": 0.65},
)


def comparison_figure(comparison: LogComparison) -> Figure:
    """Measured positions of both logs in one panel, tracking errors in a panel per joint; time from the first tracking
    cycle of a, b moved by the shift found."""
    n = comparison.a.header.n
    rows = -(-n // COLUMNS)
    with mpl.rc_context(STYLE | {"axes.titlepad": 4.0, "axes.titlesize": 10.0}):
        figure = Figure(figsize=(11.0, 3.6 + ROW_INCHES * rows), layout="constrained")
        above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=(3.2, ROW_INCHES * rows))[:, 0]
        _draw_positions(above, comparison)
        _draw_errors(below, comparison, rows)
        figure.suptitle(_headline(comparison), fontweight="bold", fontsize=12, x=0.01, ha="left")
    return figure


def _headline(comparison: LogComparison) -> str:
    return f"{comparison.a.header.robot}: a = {comparison.a.path.stem}, b = {comparison.b.path.stem}"


def _draw_positions(part: SubFigure, comparison: LogComparison) -> None:
    axes = part.subplots()
    for log, shift_s, style in ((comparison.a, 0.0, "-"), (comparison.b, comparison.shift_s, "--")):
        for j, name in enumerate(log.header.joint_names):
            time_s, values = thin(tracking_time(log) - shift_s, log.rows["q"][:, j])
            label = name.replace("_", " ") if style == "-" else None
            axes.plot(time_s, values, style, color=COLOURS[j % len(COLOURS)], label=label)
    axes.set_ylabel("measured (rad or m)" if any(comparison.a.header.prismatic) else "measured (rad)")
    axes.set_title("Positions: a solid, b dashed")
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)
    _limit_time(axes, comparison)


def _draw_errors(part: SubFigure, comparison: LogComparison, rows: int) -> None:
    all_axes = part.subplots(rows, COLUMNS, sharex=True, squeeze=False).ravel()
    for j, axes in enumerate(all_axes):
        axes.set_visible(j < comparison.a.header.n)
        if j < comparison.a.header.n:
            _draw_error(axes, comparison, j)
    for axes in all_axes[-COLUMNS:]:
        axes.set_xlabel("time since the first tracking cycle (s)")
    handles, labels = all_axes[0].get_legend_handles_labels()
    part.legend(handles, labels, loc="outside upper right", ncols=2, frameon=False)
    part.suptitle("Tracking error, desired − measured", fontweight="bold", fontsize=10, x=0.01, ha="left")


def _draw_error(axes: Axes, comparison: LogComparison, j: int) -> None:
    for name, log, shift_s, look in _both(comparison):
        time_s, values = thin(tracking_time(log) - shift_s, log.tracking_error[:, j] * 1e3)
        axes.plot(time_s, values, label=name, **look)
    joint = comparison.joints[j]
    axes.set_title(f"{joint.name.replace('_', ' ')}   rms b/a {joint.rms_ratio:.2g}", fontweight="normal")
    axes.set_ylabel("mm" if comparison.a.header.is_prismatic(j) else "mrad")
    _limit_time(axes, comparison)


def _both(comparison: LogComparison) -> tuple[tuple[str, Log, float, dict[str, Any]], ...]:
    return ("a", comparison.a, 0.0, LOOKS[0]), ("b", comparison.b, comparison.shift_s, LOOKS[1])


def _limit_time(axes: Axes, comparison: LogComparison) -> None:
    """Show the time from the first tracking cycle to the end of the longer log."""
    a, b = tracking_time(comparison.a), tracking_time(comparison.b) - comparison.shift_s
    axes.set_xlim(0.0, max(a[-1], b[-1]))
