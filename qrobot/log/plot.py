"""Figures of a log: the two of the QRobot paper (desired positions, tracking errors), torques and punctuality.

Figures are made without a display and without pyplot's global state; `save_figure` writes them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from qrobot.config.scene import FORCE_AXES
from qrobot.errors import LogError
from qrobot.log.events import LogEvent, log_events
from qrobot.log.read import Log
from qrobot.servo.modes import TORQUE_ON
from qrobot.whole_file import written_whole

# Okabe and Ito's colours, told apart by colour-blind readers too; more joints than colours get another dash.
COLOURS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
DASHES: Final = ("-", "--", ":", "-.")
STYLE: Final[dict[Any, Any]] = {
    "font.size": 10.0,
    "axes.titlesize": 12.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlepad": 24.0,  # room for the line of facts
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.3,
    "agg.path.chunksize": 20_000,
}
LEGEND: Final[dict[str, Any]] = {"loc": "center left", "bbox_to_anchor": (1.01, 0.5), "frameon": False}
MAX_POINTS: Final = 6_000  # per line; more would not be seen
DPI: Final = 150
MAX_MARKS: Final = 12  # more names would hide the lines
MARKS: Final = {"law": ("--", "#444444"), "gains": ("--", "#999999"), "fault": (":", "#CC0000")}


def positions_figure(log: Log) -> Figure:
    """Desired joint positions over time, one line per joint (QRobot paper, figure 7)."""
    return _joint_figure(log, "Desired joint positions", "position", ("rad", "m"), log.rows["q_ref"])


def errors_figure(log: Log) -> Figure:
    """Position tracking error, desired minus measured, over time (QRobot paper, figure 8)."""
    return _joint_figure(log, "Position tracking error", "desired − measured", ("rad", "m"), _error_under_torque(log))


def torques_figure(log: Log) -> Figure:
    """Commanded torques over time."""
    return _joint_figure(log, "Commanded torques", "torque", ("N·m", "N"), log.rows["tau"])


def forces_figure(log: Log) -> Figure:
    """Force and torque on the wrist's sensor over time; what is not known is not drawn."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 7.8), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        for axes, first, quantity in ((above, 0, "force (N)"), (below, 3, "torque (N·m)")):
            known = [k for k in range(first, first + 3) if np.isfinite(log.rows["force"][:, k]).any()]
            for k in known:
                axes.plot(*thin(log.time_s, log.rows["force"][:, k]), label=FORCE_AXES[k], color=COLOURS[k - first])
            axes.set_ylabel(quantity)
            _mark(axes, log_events(log))
            if known:
                axes.legend(**LEGEND)
            axes.margins(x=0.01)
        below.set_xlabel("time (s)")
        _head(above, log, "Force and torque at the wrist")
    return figure


def signals_figure(log: Log) -> Figure:
    """Numbers of law and program over time, each on an axis of its own. Raises LogError: none has a name."""
    columns = [(name, log.rows["signals"][:, k]) for k, name in enumerate(log.signal_names)]
    columns += [(name, log.rows["program_signals"][:, k]) for k, name in enumerate(log.program_signal_names)]
    if not columns:
        raise LogError(f"{log.path}: neither its law nor a program has named a signal")
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 1.4 + 1.8 * len(columns)), layout="constrained")
        all_axes = figure.subplots(len(columns), 1, sharex=True, squeeze=False)[:, 0]
        for k, (axes, (name, numbers)) in enumerate(zip(all_axes, columns, strict=True)):
            axes.plot(*thin(log.time_s, numbers), color=COLOURS[k % len(COLOURS)])
            axes.set_ylabel(name)
            _mark(axes, log_events(log))
            axes.margins(x=0.01)
        all_axes[-1].set_xlabel("time (s)")
        _head(all_axes[0], log, "Signals of law and program")
    return figure


def latency_figure(log: Log) -> Figure:
    """Histogram of the wake-up error of all cycles, both axes logarithmic."""
    late_us = np.maximum(log.rows["late_ns"] / 1e3, 1e-2)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 4.6), layout="constrained")
        axes = figure.subplots()
        top = max(10.0, float(late_us.max(initial=0.0)) * 1.2)
        axes.hist(late_us, bins=np.geomspace(1e-2, top, 120).tolist(), color=COLOURS[0])
        for quantile, style in ((50, "-"), (99, "--"), (99.9, ":")):
            if late_us.size:
                value = float(np.percentile(late_us, quantile))
                axes.axvline(value, color=COLOURS[1], linestyle=style, label=f"p{quantile:g} = {value:.3g} µs")
        axes.axvline(log.header.period_ns / 2e3, color="black", linewidth=0.8, label="half a period")
        axes.set(xscale="log", xlabel="wake-up error (µs)", ylabel="cycles", ylim=(0.5, max(10, late_us.size)))
        axes.set_yscale("log")
        _head(axes, log, "Wake-up error")
        axes.legend(**LEGEND)
    return figure


FIGURES: Final[dict[str, Callable[[Log], Figure]]] = {
    "positions": positions_figure,
    "errors": errors_figure,
    "torques": torques_figure,
    "forces": forces_figure,
    "signals": signals_figure,
    "latency": latency_figure,
}


def figures_of(log: Log) -> list[str]:
    """Names of the figures for which a log has numbers."""
    without = set() if log.signal_names or log.program_signal_names else {"signals"}
    without |= set() if np.isfinite(log.rows["force"]).any() else {"forces"}
    return [name for name in FIGURES if name not in without]


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure in the format of the file's suffix. Raises LogError when that fails."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with written_whole(path) as place:
            figure.savefig(place, dpi=DPI, format=path.suffix[1:] or "png")
    except OSError as error:
        raise LogError(f"cannot write {path}: {error.strerror}") from None
    except ValueError as error:  # an unknown suffix
        raise LogError(f"cannot write {path}: {error}") from None


def _joint_figure(log: Log, title: str, quantity: str, units: tuple[str, str], values: NDArray[Any]) -> Figure:
    """One line per joint; sliding joints, if there are any, on an axis of their own."""
    panels = _panels(log, units)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 1.4 + 3.2 * len(panels)), layout="constrained")
        all_axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (joints, unit) in zip(all_axes, panels, strict=True):
            _plot_joints(axes, log, joints, values)
            axes.set_ylabel(f"{quantity} ({unit})")
            _mark(axes, log_events(log))
            axes.legend(**LEGEND)
        all_axes[-1].set_xlabel("time (s)")
        _head(all_axes[0], log, title)
    return figure


def errors_of_runs_figure(logs: Sequence[Log]) -> Figure:
    """Position tracking errors of several runs of one robot, one below the other on the same scales."""
    panels = _panels(logs[0], ("rad", "m"))
    with mpl.rc_context(STYLE):
        size = (9.0, 1.4 + 3.2 * len(panels) * len(logs))
        figure = Figure(figsize=size, layout="constrained")
        columns = figure.subplots(len(logs) * len(panels), 1, sharex=True, squeeze=False)[:, 0]
        for k, (joints, unit) in enumerate(panels):
            of_kind = list(columns[k :: len(panels)])
            for log, axes in zip(logs, of_kind, strict=True):
                _plot_joints(axes, log, joints, _error_under_torque(log))
                axes.set_ylabel(f"desired − measured ({unit})")
                _mark(axes, log_events(log))
                axes.legend(**LEGEND)
            _share_scale(of_kind)
        for log, axes in zip(logs, columns[:: len(panels)], strict=True):
            _head(axes, log, f"Position tracking error, law {log.header.law}")
        columns[-1].set_xlabel("time (s)")
    return figure


def _error_under_torque(log: Log) -> NDArray[np.float64]:
    """Tracking error while torque was given, NaN elsewhere: a reference that is the arm's own place has none."""
    held = np.isin(log.rows["mode"], list(TORQUE_ON))
    return np.where(held[:, None], log.tracking_error, np.nan)


def _share_scale(several: Sequence[Axes]) -> None:
    """The same y range for all, so that what is smaller looks smaller."""
    low, high = np.array([axes.get_ylim() for axes in several]).T
    for axes in several:
        axes.set_ylim(low.min(), high.max())


def _panels(log: Log, units: tuple[str, str]) -> list[tuple[list[int], str]]:
    """Turning joints and sliding ones, each with its unit; those that there are."""
    sliding = [j for j in range(log.header.n) if log.header.is_prismatic(j)]
    turning = [j for j in range(log.header.n) if j not in sliding]
    return [(joints, unit) for joints, unit in ((turning, units[0]), (sliding, units[1])) if joints]


def _plot_joints(axes: Axes, log: Log, joints: Sequence[int], values: NDArray[Any]) -> None:
    for j in joints:
        time_s, line = thin(log.time_s, values[:, j])
        colour, dash = COLOURS[j % len(COLOURS)], DASHES[j // len(COLOURS) % len(DASHES)]
        axes.plot(time_s, line, label=log.header.joint_names[j], color=colour, linestyle=dash)
    axes.margins(x=0.01)


def _mark(axes: Axes, events: Sequence[LogEvent]) -> None:
    """A line with a name where another law, other gains or a fault came; of very many the first."""
    marks = [event for event in events if event.kind in MARKS]
    for event in marks[:MAX_MARKS]:
        dash, colour = MARKS[event.kind]
        axes.axvline(event.t_s, linestyle=dash, color=colour, linewidth=0.9)
        axes.annotate(
            event.short, (event.t_s, 1.0), (2, -2), xycoords=("data", "axes fraction"), textcoords="offset points",
            rotation=90, va="top", fontsize=7, color=colour,
        )  # fmt: skip


def thin(time_s: NDArray[np.float64], values: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """The line through the smallest and largest value of each stretch: no peak is lost, however long the log.

    NaN is left out where a stretch has other values.
    """
    stretch = 2 * -(-values.size // MAX_POINTS)
    if stretch <= 2:
        return time_s, values
    usable = values.size // stretch * stretch
    blocks = values[:usable].reshape(-1, stretch)
    low, high = (np.where(np.isnan(blocks), beyond, blocks) for beyond in (np.inf, -np.inf))
    starts = np.arange(0, usable, stretch)
    picks = np.sort(np.stack([starts + low.argmin(axis=1), starts + high.argmax(axis=1)], axis=1), axis=1)
    index = np.concatenate([picks.ravel(), np.arange(usable, values.size)])
    return time_s[index], values[index]


def _head(axes: Axes, log: Log, title: str) -> None:
    """The title, and below it which run this is."""
    header = log.header
    plant = f"{header.plant} plant" if header.plant else ""
    facts = [header.robot, f"{header.rate_hz:g} Hz", header.clock, plant, header.law]
    axes.set_title(title)
    axes.annotate(
        "  ·  ".join(filter(None, facts)), (0, 1), (0, 8), xycoords="axes fraction", textcoords="offset points",
        color="#666666",
    )  # fmt: skip
