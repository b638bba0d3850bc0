"""The picture at the head of the README: desired positions and tracking errors of one run, above each other.

Made by `python docs/tracking_picture.py out/demo/lockstep-1000-nominal-qrobot.mcap` after `make demo`.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from qrobot.log.plot import COLOURS, STYLE
from qrobot.log.read import Log, read_log

PICTURE: Final = Path(__file__).parent / "images/tracking.png"
DPI: Final = 100


def tracking_picture(log: Log) -> Figure:
    """Positions above errors, one colour per joint, over the same seconds."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 5.4), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        _draw(above, log, np.degrees(log.rows["q_ref"]), "desired (°)")
        _draw(below, log, log.tracking_error * 1e3, "desired − measured (mrad)")
        below.set_xlabel("time (s)")
        above.set_title("Park → end → park at triple speed, and how well the emulated PUMA 560 follows", pad=8)
        names = [name.replace("_", " ") for name in log.header.joint_names]
        figure.legend(above.lines, names, loc="outside right center", frameon=False)
    return figure


def _draw(axes: Axes, log: Log, values: np.ndarray[Any, Any], label: str) -> None:
    for joint in range(log.header.n):
        axes.plot(log.time_s, values[:, joint], color=COLOURS[joint], linewidth=1.0)
    axes.set_ylabel(label)


if __name__ == "__main__":
    PICTURE.parent.mkdir(exist_ok=True)
    tracking_picture(read_log(Path(sys.argv[1]))).savefig(PICTURE, dpi=DPI)
