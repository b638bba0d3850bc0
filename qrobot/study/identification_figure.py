"""The figure of an identification study: each arm a point, what was before beside what came of it."""

from __future__ import annotations

from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from qrobot.arrays import Floats
from qrobot.ident.fit import NORMAL_95
from qrobot.ident.friction import FRICTION_NAMES
from qrobot.log.plot import COLOURS, STYLE
from qrobot.study.identification_summary import IdentificationSummary

FOUND, BEFORE, EXACT = COLOURS[0], COLOURS[1], COLOURS[2]
SIDE: Final = 0.17  # of a group's points from its middle
WIDTH: Final = 0.11  # over which points of a group are spread
NOTHING: Final = 1e-5  # N m (N): a joint that bears nothing has errors of rounding alone
ABOVE: Final[dict[str, Any]] = {
    "loc": "lower right", "bbox_to_anchor": (1.0, 0.99), "frameon": False, "handletextpad": 0.1, "columnspacing": 0.8,
}  # fmt: skip
WIDEST: Final = 4.0  # deviations that the histogram shows


def identification_figure(summary: IdentificationSummary) -> Figure:
    """Errors of gravity and friction by joint, of the intervals, and of tracking."""
    with mpl.rc_context(STYLE | {"axes.titlepad": 6.0, "axes.titlesize": 10.5}):
        figure = Figure(figsize=(11.0, 7.6), layout="constrained")
        (gravity, friction), (intervals, tracking) = figure.subplots(2, 2)
        _draw_gravity(gravity, summary)
        _draw_friction(friction, summary)
        _draw_intervals(intervals, summary)
        _draw_tracking(tracking, summary)
        figure.suptitle(
            f"{len(summary.seeds)} arms nobody was told of", fontweight="bold", fontsize=12, x=0.01, ha="left"
        )
    return figure


def _draw_gravity(axes: Axes, summary: IdentificationSummary) -> None:
    _points(axes, summary.gravity_before, -SIDE, BEFORE, "robot file")
    _points(axes, summary.gravity, SIDE, FOUND, "identified")
    axes.set(yscale="log", ylabel="rms error (N·m or N)", title="Gravity at other poses")
    axes.set_ylim(bottom=max(NOTHING, axes.get_ylim()[0]))
    _name_joints(axes, summary.joints)
    axes.legend(ncols=2, **ABOVE)


def _draw_friction(axes: Axes, summary: IdentificationSummary) -> None:
    for kind, name in enumerate(FRICTION_NAMES):
        label = name.replace("_pos", " +").replace("_neg", " −")
        _points(axes, 100.0 * summary.friction_error[:, :, kind], (kind - 1) * 1.5 * SIDE, COLOURS[kind], label)
    axes.set(ylabel="error (% of the truth)", title="Friction")
    _name_joints(axes, summary.joints)
    axes.legend(ncols=len(FRICTION_NAMES), **ABOVE)


def _draw_intervals(axes: Axes, summary: IdentificationSummary) -> None:
    shown = np.clip(summary.deviations[summary.known], -WIDEST, WIDEST)
    bins = np.linspace(-WIDEST, WIDEST, 33)
    axes.hist(shown, bins.tolist(), density=True, color=FOUND, alpha=0.6, label="all values of all arms")
    z = np.linspace(-WIDEST, WIDEST, 200)
    axes.plot(z, np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi), color="black", linewidth=1.0, label="normal")
    for edge in (-NORMAL_95, NORMAL_95):
        axes.axvline(edge, color="#444444", linestyle="--", linewidth=0.9)
    share = 100.0 * summary.inside.sum() / summary.known.sum()
    axes.set(xlabel="error in the fit's own standard deviations", ylabel="density")
    axes.set_title(f"{share:.0f} % of the truths are inside the 95 % intervals")
    axes.legend(frameon=False)


def _draw_tracking(axes: Axes, summary: IdentificationSummary) -> None:
    axes.set_title("Tracking of the paper's experiment")
    if not summary.tracking:
        axes.text(0.5, 0.5, "not tried", transform=axes.transAxes, ha="center", color="#666666")
        return
    for place, (name, colour) in enumerate((("before", BEFORE), ("after", FOUND), ("exact", EXACT))):
        _points(axes, 1e3 * np.linalg.norm(summary.tracking[name], axis=1)[:, None], place, colour, None)
    axes.set_xticks(range(3), ["robot file", "identified", "exact model"])
    axes.set(ylabel="rms error, norm over joints (mrad or mm)", ylim=(0.0, None))


def _points(axes: Axes, values: Floats, shift: float, colour: str, label: str | None) -> None:
    """A column of points for each of (a, n), spread a little, and their median as a bar."""
    spread = WIDTH * (np.random.default_rng(0).uniform(size=len(values)) - 0.5)
    for j, column in enumerate(values.T):
        at = j + shift
        axes.plot(at + spread, column, ".", color=colour, markersize=4.0, alpha=0.6, label=label if j == 0 else None)
        axes.plot([at - WIDTH, at + WIDTH], [np.median(column)] * 2, color=colour, linewidth=2.0)


def _name_joints(axes: Axes, joints: tuple[str, ...]) -> None:
    axes.set_xticks(range(len(joints)), [name.replace("_", " ") for name in joints])
    axes.set_xlim(-0.6, len(joints) - 0.4)
