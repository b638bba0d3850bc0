"""The picture of the how-to on pressing: force on the table and height of the tip, in a run of the law `force`.

Made by `python docs/pressing_picture.py`, in lock-step.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from qrobot.config import load_robot
from qrobot.config.deployment import load_deployment
from qrobot.log.plot import COLOURS, STYLE
from qrobot.model.arm import Arm
from qrobot.model.transform import transform
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.mujoco_plant import PlantMemory

PICTURE: Final = Path(__file__).parent / "images/pressing.png"
DPI: Final = 100
LOOK_S: Final = 0.004
PHASE_S: Final = 3.0
LOWER_M: Final = 0.01


def pressing_run() -> np.ndarray[Any, Any]:
    """Seconds, newtons and millimetres: the arm finds the table, then the table is lowered. Shape (k, 3)."""
    board, robot = load_deployment("pressing").arm[0].board, load_robot("puma560")
    arm, length = Arm(robot), board.scene.tool.length_m + robot.geometry.flange_m
    x, y, top = board.scene.position_m
    above = transform(np.diag([1.0, -1.0, -1.0]), [x, y, top + 0.003 + length])
    start = arm.nearest(above, robot.poses["park"])
    emulator = Emulator(robot, scene=board.scene, force_sensor=board.force_sensor, start=start)
    rig = LockstepRig(robot, ServoSettings(law="force", sensor_channels=(6,)), emulator, keep_telemetry=False)
    plant = emulator.plant
    assert isinstance(plant, PlantMemory)
    rig.run_for(0.05)
    rig.mailbox.request_power(True)
    seen = []
    for place in (top, top - LOWER_M):
        plant.move_scene((x, y, place))
        for _ in range(round(PHASE_S / LOOK_S)):
            rig.run_for(LOOK_S)
            T = arm.forward(emulator.q)
            tip = T[2, 3] + length * T[2, 2] - top
            seen.append([LOOK_S * len(seen), plant.contact_force()[2], 1e3 * tip])
    return np.array(seen)


def pressing_picture(seen: np.ndarray[Any, Any]) -> Figure:
    """Force above height, over the same seconds."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 4.8), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        for axes, column, label in ((above, 1, "force on the tip (N)"), (below, 2, "tip over the table (mm)")):
            axes.plot(seen[:, 0], seen[:, column], color=COLOURS[column], linewidth=1.2)
            axes.set_ylabel(label)
        below.set_xlabel("time (s)")
        above.set_title("20 N on a table, which is lowered by a centimetre after three seconds", pad=8)
    return figure


if __name__ == "__main__":
    pressing_picture(pressing_run()).savefig(PICTURE, dpi=DPI)
