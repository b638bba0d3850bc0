"""The picture of the how-to on slowing down: one motion as programmed, and changed while it is under way.

Made by `python docs/override_picture.py`, off line.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from qrobot import rccl
from qrobot.arrays import Floats
from qrobot.config import load_robot
from qrobot.log.plot import COLOURS, STYLE
from qrobot.model.arm import Arm
from qrobot.rccl.offline import OfflineLink

PICTURE: Final = Path(__file__).parent / "images/override.png"
DPI: Final = 100
PERIOD_S: Final = 0.028
WORDS: Final = ((0.9, 40.0, False, "40 %"), (2.6, 40.0, True, "pause"), (4.0, 100.0, False, "resume, 100 %"))
PLACES: Final = ((60.0, -20.0, 20.0), (60.0, 10.0, -50.0), (0.0, 0.0, 0.0))  # of the first joints, from park


def run(changed: bool) -> Floats:
    """Joints at each sample of a motion round two places. Shape (samples, n)."""
    places = list[Floats]()
    with rccl.use(OfflineLink), rccl.control("puma560") as arm:

        def look() -> None:
            places.append(np.radians(arm.joints))
            seconds = PERIOD_S * len(places)
            for at, percent, held, _ in WORDS if changed else ():
                if abs(seconds - at) < 0.5 * PERIOD_S:
                    arm.override(percent)
                    (arm.pause if held else arm.resume)()

        park = arm.joints.copy()
        arm.setjvel(share=0.7)
        arm.each_sample(look)
        for place in PLACES:
            arm.move(arm.jposition("place", [*(park[:3] + place), *park[3:]]))
        arm.waitfor(arm.completed)
        arm.each_sample(None)
    return np.array(places)


def picture(plain: Floats, changed: Floats) -> Figure:
    """The way of the flange seen from above, and its speed over time."""
    arm = Arm(load_robot("puma560"))
    ways = [1e3 * np.array([arm.forward(q)[:3, 3] for q in each]) for each in (plain, changed)]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 4.6), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.5))
        left.plot(ways[0][:, 0], ways[0][:, 1], color=COLOURS[0], linewidth=4.0, alpha=0.35, label="as programmed")
        left.plot(ways[1][:, 0], ways[1][:, 1], ".", color=COLOURS[1], markersize=2.5, label="changed, each sample")
        left.set(xlabel="x (mm)", ylabel="y (mm)", title="The same places", aspect="equal")
        left.legend(frameon=False, loc="lower left")
        for way, colour in zip(ways, COLOURS, strict=False):
            speeds = np.linalg.norm(np.diff(way, axis=0), axis=1) / PERIOD_S
            right.plot(PERIOD_S * np.arange(len(speeds)), speeds, color=colour, linewidth=1.4)
        for at, _, _, word in WORDS:
            right.axvline(at, color="0.6", linewidth=0.8)
            right.annotate(
                word, (at, 1.0), xycoords=("data", "axes fraction"), xytext=(3, -12), textcoords="offset points"
            )
        right.set(xlabel="time (s)", ylabel="speed of the flange (mm/s)", title="Another time")
    return figure


if __name__ == "__main__":
    picture(run(changed=False), run(changed=True)).savefig(PICTURE, dpi=DPI)
