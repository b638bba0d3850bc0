"""The picture of the how-to on loads: an arm that swings 2.5 kg, before and after it was told of them.

Made by `python docs/payload_picture.py`, in lock-step.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from qrobot import rccl
from qrobot.config import load_robot
from qrobot.log.plot import COLOURS, STYLE
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator

PICTURE: Final = Path(__file__).parent / "images/payload.png"
DPI: Final = 100
LOAD_KG: Final = 2.5
JOINTS: Final = (1, 2, 4)  # those that a weight at the flange bends
SETTLED: Final = 1500  # cycles until power is on and the arm moves


def swung() -> np.ndarray[Any, Any]:
    """Rows of telemetry: two swings there and back, and the load told between them."""
    robot = load_robot("puma560")
    servo = ServoSettings(rate_hz=1000.0, law="computed-torque")
    rig = LockstepRig(robot, servo, Emulator(robot, physics="rigid", payload_kg=LOAD_KG))
    with rccl.use(partial(link_factory, rig, 28_000)), rccl.control(robot.name) as arm:
        for load_kg in (None, LOAD_KG):
            if load_kg is not None:
                arm.setload(load_kg)
            for name in ("ready", "park"):
                arm.move(arm.pose(name))
            arm.waitfor(arm.completed)
    return rig.rows()[SETTLED:]


def picture(rows: np.ndarray[Any, Any]) -> Figure:
    """The load that the servo reckons with, and tracking errors, over the same seconds."""
    robot, seconds = load_robot("puma560"), (rows["t_ns"] - rows["t_ns"][0]) * 1e-9
    errors = 1e3 * (rows["q_ref"] - rows["q"])
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 4.8), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1.0, 2.4))
        above.plot(seconds, rows["payload"][:, 0], color=COLOURS[0], linewidth=1.4)
        above.set_ylabel("told (kg)")
        above.set_title(f"{LOAD_KG:g} kg in the hand: one swing before and one after `setload`", pad=8)
        for number, joint in enumerate(JOINTS):
            below.plot(seconds, errors[:, joint], color=COLOURS[number], linewidth=1.2, label=robot.joint_names[joint])
        below.set_ylabel("desired − measured (mrad)")
        below.set_xlabel("time (s)")
        below.legend(frameon=False, loc="lower right")
    return figure


if __name__ == "__main__":
    picture(swung()).savefig(PICTURE, dpi=DPI)
