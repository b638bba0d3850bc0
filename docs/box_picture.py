"""The picture of the tutorial on positions: the box, as it was asked for and as it was measured.

Made by `python docs/box_picture.py`, in lock-step; the figure is the one that `qrobot run --output` draws.
"""

from __future__ import annotations

import runpy
from functools import partial
from pathlib import Path
from typing import Final

from qrobot import rccl
from qrobot.cli.motion_figures import path_figure, path_of
from qrobot.config import load_robot
from qrobot.rccl.trace import Trace
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator

DOCS: Final = Path(__file__).parent
PICTURE: Final = DOCS / "images/box.png"
DPI: Final = 80
PERIOD_US: Final = 28_000


def box_run() -> Trace:
    """What the example asked for, and where the arm was."""
    robot, traces = load_robot("puma560"), list[Trace]()
    rig = LockstepRig(robot, ServoSettings(), Emulator(robot), keep_telemetry=False)
    with rccl.use(partial(link_factory, rig, PERIOD_US), traces):
        runpy.run_path(str(DOCS.parent / "examples/12_box.py"), run_name="__main__")
    return traces[0]


if __name__ == "__main__":
    trace = box_run()
    asked, measured = (path_of(trace.robot, q) for q in (trace.setpoints.q, trace.measured))
    path_figure(trace.robot.name, asked, measured).savefig(PICTURE, dpi=DPI)
