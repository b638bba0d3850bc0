"""The picture of the page on the C surface: `end`, `code`, `scal` and `update` over the motions that they belong to.

Made by `python docs/instants_picture.py`, off line.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from qrobot import rccl
from qrobot.log.plot import COLOURS, STYLE
from qrobot.model.arm import Arm
from qrobot.rccl import EQ, TL, Position, gentr_rot, gentr_trsl, makeposition, t6, yunit
from qrobot.rccl.channel import Channel
from qrobot.rccl.offline import OfflineLink

PICTURE: Final = Path(__file__).parent / "images/instants.png"
DPI: Final = 100
STOPPED_BY: Final = 7  # the code that the program gives to `nextmove`
HALF: Final = 0.5


@dataclass(frozen=True)
class Seen:
    """What was there at one sample.

    Attributes:
        t_s: time.
        tip_mm: where the setpoints have the tip of the tool. Shape (3,).
        scal, code, end: of each position.
        updated: `update` has done its work.
    """

    t_s: float
    tip_mm: np.ndarray[Any, Any]
    scal: tuple[float, ...]
    code: tuple[int, ...]
    end: tuple[int, ...]
    updated: bool


def seen_motions() -> tuple[list[Seen], list[Position]]:
    """A via point, a dwell, and a motion that is interrupted; all there was at each sample, and the three positions."""
    e, table = gentr_trsl("E", 0, 0, 100), gentr_rot("TABLE", 500, 50, -300, yunit, 180)
    places = {"A": (0, 120, 0), "B": (-120, 120, 0), "C": (-120, -60, 0)}
    terms = [gentr_trsl(name, *place) for name, place in places.items()]
    start, *positions = [
        makeposition(name, t6, e, EQ, table, term, TL, e)
        for name, term in zip(("START", *places), (gentr_trsl("START", 0, 0, 0), *terms), strict=True)
    ]
    seen: list[Seen] = []
    with rccl.use(OfflineLink), rccl.control() as arm:
        model, found = Arm(arm.robot), terms[-1]
        arm.setmode("cartesian")
        arm.setvel(200, 90)
        arm.move(start)
        arm.waitfor(arm.completed)
        before = found.value.copy()

        def look() -> bool:
            tip = model.forward(np.array(arm.chg.setpoints)) @ e.value
            told = zip(*((p.scal, p.code, p.end.count) for p in positions), strict=True)
            seen.append(Seen(arm.time / 1e3, 1e3 * tip[:3, 3], *told, not np.array_equal(found.value, before)))
            if positions[2].scal > HALF and not positions[2].code:
                arm.nextmove(STOPPED_BY)
            return arm.completed.count > 0

        _ask_for(arm, positions, found)
        arm.waitas(look)
    return seen, positions


def _ask_for(arm: Channel, positions: list[Position], found: rccl.Transform) -> None:
    a, b, c = positions
    arm.move(a)
    arm.move(b)
    arm.setime(0, 400)
    arm.move(b)
    arm.update(found, c)
    arm.move(c)


def instants_picture(seen: list[Seen], positions: list[Position]) -> Figure:
    """Speed of the tip above `scal` of each position, over the same seconds, with marks where a motion ends."""
    t = np.array([row.t_s for row in seen]) - seen[0].t_s
    tip = np.array([row.tip_mm for row in seen])
    speed = np.linalg.norm(np.gradient(tip, t, axis=0), axis=1)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 5.4), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        above.plot(t, speed, color=COLOURS[6])
        above.set_ylabel("speed of the tip (mm/s)")
        above.set_title("move(a); move(b); setime(0, 400); move(b); update(loc, c); move(c); ... nextmove = 7;", pad=40)
        for index, position in enumerate(positions):
            scal = [row.scal[index] for row in seen]
            below.plot(t, scal, color=COLOURS[index], label=f"{position.name.lower()}->scal", marker=".", markersize=3)
            _mark_ends((above, below), t, seen, index, position.name.lower())
        updated = t[[row.updated for row in seen].index(True)]
        _mark((above, below), updated, "update ", COLOURS[2], ":", side="right")
        below.set(xlabel="time (s)", ylabel="how much is done", ylim=(-0.05, 1.1))
        below.legend(loc="center left", frameon=False)
    return figure


def _mark_ends(panels: tuple[Axes, Axes], t: np.ndarray[Any, Any], seen: list[Seen], index: int, name: str) -> None:
    for k in range(1, len(seen)):
        if seen[k].end[index] > seen[k - 1].end[index]:
            code = seen[k].code[index]
            _mark(panels, t[k], f"{name}->end\ncode {code}", COLOURS[index], "--", "left" if code > 0 else "center")


def _mark(panels: tuple[Axes, Axes], t_s: float, text: str, colour: str, dash: str, side: str) -> None:
    for axes in panels:
        axes.axvline(t_s, color=colour, linestyle=dash, linewidth=0.9)
    panels[0].annotate(
        text, (t_s, 1.0), (0, 3), xycoords=("data", "axes fraction"), textcoords="offset points", ha=side,
        va="bottom", fontsize=8, color=colour,
    )  # fmt: skip


if __name__ == "__main__":
    instants_picture(*seen_motions()).savefig(PICTURE, dpi=DPI)
