"""The picture of the how-to on fences: an arm before a bench and inside a cell, and a motion that is refused.

Made by `python docs/fences_picture.py`; the fences are those of the page.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from qrobot.arrays import Floats
from qrobot.config import load_robot
from qrobot.config.fences import Fence, FencesChoice
from qrobot.fences.fence_set import FenceSet
from qrobot.log.plot import COLOURS, STYLE

DOCS: Final = Path(__file__).parent
PAGE: Final = DOCS / "how-to/keep-inside-fences.md"
PICTURE: Final = DOCS / "images/fences.png"
DPI: Final = 100
GOAL_DEG: Final = (0.0, 35.0, 0.0, 0.0, 0.0, 0.0)  # from park: into the bench
X, Y, Z = 0, 1, 2


def fences_of_page() -> FenceSet:
    """The fences that the page tells, round the arm of its deployment."""
    found = re.search(r"```toml\n(\[arm\.fences\].*?)```", PAGE.read_text(), re.DOTALL)
    if found is None:
        raise ValueError(f"{PAGE} tells no fences")
    chosen = FencesChoice.model_validate(tomllib.loads(found[1])["arm"]["fences"])
    return FenceSet(load_robot("puma560"), chosen.shape, chosen.self_collision, chosen.self_margin_m)


def draw_arm(axes: Axes, fences: FenceSet, q: Floats, across: int, **style: object) -> None:
    """The capsules at `q` (n,), seen along y (`across` is X) or z (`across` is Y), each as its outline."""
    up = Z if across == X else X
    for _name, start, end, radius in fences.capsules_at(q):
        a, b = start[[across, up]], end[[across, up]]
        along = b - a
        heading = np.arctan2(along[1], along[0])
        turn = np.linspace(np.pi / 2, 3 * np.pi / 2, 30)
        ends = [a + radius * np.array([np.cos(t + heading), np.sin(t + heading)]) for t in turn]
        ends += [b - radius * np.array([np.cos(t + heading), np.sin(t + heading)]) for t in turn]
        axes.fill(*np.array(ends).T, **style)


def draw_fence(axes: Axes, fence: Fence, across: int) -> None:
    """A box or a cylinder whose axes are those of the base, and the margin that motions keep."""
    up = Z if across == X else X
    size = fence.size_m or (2 * (fence.radius_m or 0), 2 * (fence.radius_m or 0), fence.length_m or 0)
    colour = COLOURS[1] if fence.keep == "out" else COLOURS[2]
    for grown, line in ((0.0, "-"), (fence.margin_m if fence.keep == "out" else -fence.margin_m, ":")):
        width, height = size[across] + 2 * grown, size[up] + 2 * grown
        corner = (fence.position_m[across] - width / 2, fence.position_m[up] - height / 2)
        filled = fence.keep == "out" and grown == 0.0
        axes.add_patch(Rectangle(corner, width, height, fill=False, edgecolor=colour, linestyle=line))
        if filled:
            axes.add_patch(Rectangle(corner, width, height, facecolor=colour, alpha=0.25))
    left, top = (corner[0] + 0.02, corner[1] + 0.02) if fence.keep == "in" else (corner[0], corner[1] - 0.07)
    axes.text(left, top, f"{fence.name}: keep {fence.keep}", color=colour)


def fences_picture(fences: FenceSet) -> Figure:
    """The arm from the side: where it stands, where a motion may still get to, and the goal that is refused."""
    park = load_robot("puma560").poses["park"]
    goal = park + np.radians(GOAL_DEG)
    last = park + fences.clear_share(park, goal) * (goal - park)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.8, 5.8), layout="constrained")
        axes = figure.subplots()
        for fence in fences.fences:
            draw_fence(axes, fence, X)
        draw_arm(axes, fences, goal, X, fill=False, edgecolor=COLOURS[1], linestyle="--", linewidth=0.8)
        draw_arm(axes, fences, last, X, facecolor="0.75", edgecolor="0.5", linewidth=0.8, alpha=0.6)
        draw_arm(axes, fences, park, X, facecolor=COLOURS[0], edgecolor=COLOURS[0], linewidth=0.8, alpha=0.55)
        axes.set(aspect="equal", xlabel="x (m)", ylabel="z (m)", xlim=(-1.0, 1.0), ylim=(-0.8, 0.8))
        axes.set_title("From the side: park, a refused goal, and how far the way is free", pad=8)
    return figure


if __name__ == "__main__":
    fences_picture(fences_of_page()).savefig(PICTURE, dpi=DPI)
