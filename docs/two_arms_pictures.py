"""The pictures of the how-tos on two arms and on tasks of RCI: hands that carry one object, mirrors, a spring.

Made by `python docs/two_arms_pictures.py`, in lock-step.
"""

from __future__ import annotations

import runpy
from contextlib import redirect_stdout
from functools import partial
from io import StringIO
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from qrobot import rci
from qrobot.config import load_robot
from qrobot.log.plot import COLOURS, STYLE
from qrobot.model.arm import Arm
from qrobot.model.transform import inverse
from qrobot.rccl import gentr_rpy, gentr_trsl
from qrobot.rccl.offline import OfflineLink
from qrobot.rccl.program import ending
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator

DOCS: Final = Path(__file__).parent
IMAGES: Final = DOCS / "images"
DPI: Final = 100
PERIOD_US: Final = 28_000
ROBOT: Final = load_robot("puma560")
TOOL: Final = gentr_trsl("TOOL", 0, 0, 150).value
WORLD: Final = {"left": np.eye(4), "right": gentr_rpy("RIGHT", 1000, 0, 0, 180, 0, 0).value}
"""The world in the base of either arm, as the example has it."""
GRIPS_MM: Final = 200.0  # between the two places at which the hands hold the object
Rows = np.ndarray[Any, Any]


def run_of(example: str, *names: str) -> tuple[dict[str, Rows], dict[str, Any]]:
    """Rows of telemetry of each arm that an example moves, and what its names stand for at the end."""
    rigs = {name: LockstepRig(ROBOT, ServoSettings(), Emulator(ROBOT)) for name in names}
    with rci.use({name: partial(link_factory, rig, PERIOD_US) for name, rig in rigs.items()}), ending():
        names_in_it = runpy.run_path(str(DOCS.parent / "examples" / example), run_name="__main__")
    return {name: rig.rows() for name, rig in rigs.items()}, names_in_it


def hands_of(rows: Rows, name: str) -> np.ndarray:
    """Places of a hand in the world, m. Shape (samples, 4, 4)."""
    arm, to_world = Arm(ROBOT), inverse(WORLD[name])
    return np.array([to_world @ arm.forward(q) @ TOOL for q in rows["q"][::10]])


def hands_picture(run: dict[str, Rows], apart: list[float]) -> Figure:
    """Ways of both hands from the side, and their distance at each sample while they carry."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 3.8), layout="constrained")
        ways, distance = figure.subplots(1, 2)
        for number, (name, rows) in enumerate(run.items()):
            x, _, z = 1e3 * hands_of(rows, name)[:, :3, 3].T
            ways.plot(x, z, color=COLOURS[number], linewidth=1.2, label=f"{name} hand")
            ways.plot(x[-1], z[-1], "o", color=COLOURS[number])
        ways.set(xlabel="x (mm)", ylabel="z (mm)", title="Ways of the hands, from the side")
        ways.legend(frameon=False)
        seconds, off = np.arange(len(apart)) * PERIOD_US * 1e-6, 1e3 * np.array(apart) - GRIPS_MM
        distance.plot(seconds, off, color=COLOURS[2], linewidth=1.2)
        distance.set(xlabel="time (s)", ylabel=f"distance of the hands - {GRIPS_MM:g} mm (mm)", ylim=(-1, 1))
        distance.set_title("While they carry the object")
    return figure


def tasks_picture(mirror: dict[str, Rows], spring: Rows) -> Figure:
    """Waists of master and slave; the joint that is a spring beside one that is held."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 3.8), layout="constrained")
        waists, joints = figure.subplots(1, 2)
        for number, (name, rows) in enumerate(mirror.items()):
            waists.plot(np.arange(len(rows)) * 1e-3, np.degrees(rows["q"][:, 0]), color=COLOURS[number], label=name)
        waists.set(xlabel="time (s)", ylabel="waist (degrees)", title="A master, and a slave that mirrors it")
        waists.legend(frameon=False)
        gone = np.degrees(spring["q"] - spring["q"][0])
        for number, (joint, label) in enumerate(((0, "waist, a spring"), (1, "shoulder, held"))):
            joints.plot(np.arange(len(gone)) * 1e-3, gone[:, joint], color=COLOURS[number], label=label)
        joints.set(xlabel="time (s)", ylabel="gone from where it stood (degrees)", title="A hybrid controller")
        joints.legend(frameon=False)
    return figure


def table_of(example: str) -> list[tuple[int, str]]:
    """Instants (ticks) and tasks of the table that an example prints off line."""
    printed = StringIO()
    with redirect_stdout(printed), rci.use(OfflineLink), ending():
        runpy.run_path(str(DOCS.parent / "examples" / example), run_name="__main__")
    rows = [line.split() for line in printed.getvalue().splitlines()]
    return [(int(row[0]), row[1]) for row in rows if len(row) == 3 and row[0].isdecimal()]


def examples_picture(places: Rows, table: list[tuple[int, str]], mirror: dict[str, Rows]) -> Figure:
    """Way of a tool over a table that turns; runs of two tasks on one clock; the mirror at 4 ms."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 3.4), layout="constrained")
        way, clock, waists = figure.subplots(1, 3)
        arm, tool = Arm(ROBOT), gentr_trsl("TOOL", 0, 0, 100).value
        x, y, z = 1e3 * np.array([(arm.forward(q) @ tool)[:3, 3] for q in places["q"][::10]]).T
        low = z < z.min() + 20.0  # the way to the table is left out
        way.plot(x[low], y[low], color=COLOURS[0], linewidth=1.2)
        way.set(xlabel="x (mm)", ylabel="y (mm)", title="Over a table that turns", aspect="equal")
        for number, name in enumerate(dict.fromkeys(name for _, name in table)):
            ticks = [tick for tick, task in table if task == name]
            clock.eventplot(ticks, lineoffsets=-number, linelengths=0.6, linewidths=3, colors=COLOURS[number])
            clock.text(ticks[0], -number + 0.36, name)
        clock.set(xlabel="tick of the clock", yticks=[], title="Two tasks of one clock")
        for number, (name, rows) in enumerate(mirror.items()):
            seconds = np.arange(len(rows)) * 1e-3
            waists.plot(seconds, np.degrees(rows["q"][:, 0]), color=COLOURS[number], label=name)
        waists.set(xlabel="time (s)", ylabel="waist (degrees)", title="A mirror at 4 ms, compiled")
        waists.legend(frameon=False)
    return figure


if __name__ == "__main__":
    hands, names = run_of("22_two_hands.py", "left", "right")
    hands_picture(hands, names["apart"]).savefig(IMAGES / "two_hands.png", dpi=DPI)
    mirrored, _ = run_of("16_mirror.py", "left", "right")
    sprung, _ = run_of("17_spring.py", "puma560")
    tasks_picture(mirrored, sprung["puma560"]).savefig(IMAGES / "rci_tasks.png", dpi=DPI)
    four, _ = run_of("18_four_places.py", "puma560")
    fast, _ = run_of("27_compiled_mirror.py", "left", "right")
    examples_picture(four["puma560"], table_of("15_rci_tasks.py"), fast).savefig(IMAGES / "rci_examples.png", dpi=DPI)
