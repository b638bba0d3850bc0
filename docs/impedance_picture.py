"""The picture of the how-to on impedance: a pushed shoulder under three values of stiffness.

Made by `python docs/impedance_picture.py`, in lock-step.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from qrobot.config import load_robot
from qrobot.hwif.board_memory import PANEL_MICRO
from qrobot.log.plot import COLOURS, STYLE
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.calibration.table import load_table
from qrobot.servo.laws.law_swap import ask_for_settings
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator

PICTURE: Final = Path(__file__).parent / "images/impedance.png"
DPI: Final = 100
SHOULDER: Final = 1
PUSH_NM: Final = 70.0
STIFFNESS: Final = (600.0, 1200.0, 400.0)  # N m/rad, one after the other
PHASE_S: Final = 2.0


def pushed_run() -> np.ndarray[Any, Any]:
    """Rows of telemetry: a push after half a second, then another stiffness every two seconds."""
    robot = load_robot("puma560")
    start = np.array(robot.poses["ready"]) + np.array([0.3, 0.2, 0.4, 0.3, 0.7, 0.1])
    table = load_table("puma560", robot)
    servo = ServoSettings(law="joint_impedance", law_settings={"stiffness_2": STIFFNESS[0]}, calibration=table)
    rig = LockstepRig(robot, servo, Emulator(robot, start=start, physics="rigid"))
    rig.run_for(0.3)
    rig.mailbox.request_power(True)
    rig.run_for(0.5)
    rig.take_rows()
    rig.run_for(0.5)
    rig.board.panel.push[SHOULDER] = round(PUSH_NM * PANEL_MICRO)
    for stiffness in STIFFNESS:
        ask_for_settings(rig.state.swap, rig.law.with_settings({"stiffness_2": stiffness}).values)
        rig.run_for(PHASE_S)
    return rig.rows()


def impedance_picture(rows: np.ndarray[Any, Any]) -> Figure:
    """Stiffness, torque and way of the shoulder, over the same seconds."""
    seconds = (rows["t_ns"] - rows["t_ns"][0]) * 1e-9
    curves = (
        ("stiffness (N m/rad)", rows["signals"][:, SHOULDER]),
        ("motor torque (N m)", rows["tau"][:, SHOULDER]),
        ("given way (mrad)", 1e3 * (rows["q"] - rows["q_ref"])[:, SHOULDER]),
    )
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 6.0), layout="constrained")
        for number, (axes, (label, values)) in enumerate(zip(figure.subplots(3, 1, sharex=True), curves, strict=True)):
            axes.plot(seconds, values, color=COLOURS[number], linewidth=1.2)
            axes.set_ylabel(label)
            if number == 0:
                axes.set_title(f"A push of {PUSH_NM:g} N m at the shoulder, and three values of stiffness", pad=8)
        axes.set_xlabel("time (s)")
    return figure


if __name__ == "__main__":
    impedance_picture(pushed_run()).savefig(PICTURE, dpi=DPI)
