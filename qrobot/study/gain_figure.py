"""The figure of a gain study: how errors and chatter go with the bandwidth, for the median and the worst arm."""

from __future__ import annotations

from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from qrobot.log.plot import COLOURS, STYLE
from qrobot.study.gain_summary import GainSummary, PairSummary

PANELS: Final = {
    "rms": "rms error (% of what the guard allows)",
    "largest": "largest error (% of what the guard allows)",
    "chatter": "torque change per cycle (% of the limit)",
}


def gain_figure(summary: GainSummary) -> Figure:
    """A panel for each measure, of the worst joint; a line for each damping from the median up to the worst arm."""
    with mpl.rc_context(STYLE | {"axes.titlepad": 6.0, "axes.titlesize": 10.5}):
        figure = Figure(figsize=(11.0, 4.0), layout="constrained")
        for axes, (measure, label) in zip(figure.subplots(1, len(PANELS)), PANELS.items(), strict=True):
            _draw(axes, summary, measure)
            axes.set(xscale="log", xlabel="bandwidth over the robot file's", ylabel=label, ylim=(0.0, None))
            _tick(axes, summary)
        axes.legend(frameon=False, title="damping")
        figure.suptitle(_headline(summary), fontweight="bold", fontsize=12, x=0.01, ha="left")
    return figure


def _draw(axes: Axes, summary: GainSummary, measure: str) -> None:
    for number, damping in enumerate(sorted({pair.damping for pair in summary.pairs})):
        pairs = sorted((pair for pair in summary.pairs if pair.damping == damping), key=lambda pair: pair.bandwidth)
        ran = [pair for pair in pairs if not np.isnan(getattr(pair, measure)).all()]
        factor, values = [pair.bandwidth for pair in ran], [100.0 * getattr(pair, measure) for pair in ran]
        colour = COLOURS[number % len(COLOURS)]
        axes.plot(factor, [np.nanmedian(v) for v in values], "o-", color=colour, label=f"{damping:g}", markersize=4)
        axes.fill_between(
            factor, [np.nanmedian(v) for v in values], [np.nanmax(v) for v in values], color=colour, alpha=0.15
        )
        _cross_out(axes, [pair for pair in pairs if pair.faults], colour)


def _cross_out(axes: Axes, stopped: list[PairSummary], colour: str) -> None:
    """A cross on the axis where some arm was stopped by its servo."""
    factors, at_axis = [pair.bandwidth for pair in stopped], axes.get_xaxis_transform()
    axes.plot(factors, [0.02] * len(stopped), "x", color=colour, transform=at_axis)


def _tick(axes: Axes, summary: GainSummary) -> None:
    bandwidths = sorted({pair.bandwidth for pair in summary.pairs})
    axes.set_xticks(bandwidths, [f"{bandwidth:g}" for bandwidth in bandwidths])
    axes.set_xticks([], minor=True)


def _headline(summary: GainSummary) -> str:
    best = summary.best
    choice = (
        "no pair stops none of them"
        if best is None
        else f"best for the worst: bandwidth × {best.bandwidth:g}, damping × {best.damping:g}"
    )
    return f"{summary.arms} arms; line: median arm, shade: up to the worst; {choice}"
