"""The picture of the how-to on leading: a recording with the trembling of a hand, and what smoothing makes of it.

Made by `python docs/led_by_hand_picture.py`, in lock-step.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from qrobot.config import load_robot
from qrobot.hwif.board_memory import PANEL_MICRO
from qrobot.log.plot import COLOURS, STYLE
from qrobot.rccl.guiding import GuidedArm
from qrobot.rccl.recordings import smoothed, trimmed
from qrobot.rccl.setpoints import Setpoints
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.calibration.table import load_table
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator

PICTURE: Final = Path(__file__).parent / "images/led_by_hand.png"
DPI: Final = 100
TOLERANCE_M: Final = 0.01
ELBOW: Final = 2
PUSH_NM: Final = 16.0
TREMBLING_NM: Final = 9.0
SAMPLES: Final = 110


def led_run() -> Setpoints:
    """The elbow is led out and back again by a hand that trembles at 5 Hz."""
    robot = load_robot("puma560")
    start = np.array(robot.poses["ready"]) + np.array([0.3, 0.2, 0.4, 0.3, 0.7, 0.1])
    servo = ServoSettings(calibration=load_table("puma560", robot))
    rig = LockstepRig(robot, servo, Emulator(robot, start=start, physics="rigid"), keep_telemetry=False)
    rig.run_for(0.3)
    with GuidedArm(partial(link_factory, rig, 28_000), "puma560") as arm:
        for k in range(-40, SAMPLES + 20):
            t = 0.028 * k
            push = np.sign(np.sin(2.0 * np.pi * k / SAMPLES)) * PUSH_NM + TREMBLING_NM * np.sin(10.0 * np.pi * t)
            rig.board.panel.push[ELBOW] = round(push * PANEL_MICRO) if 0 <= k < SAMPLES else 0
            arm.step(held=-39 < k <= SAMPLES)
    return arm.recordings[0]


def led_picture(led: Setpoints) -> Figure:
    """Place and speed of the elbow, as led and smoothed."""
    robot = load_robot("puma560")
    raw, smooth = trimmed(led), smoothed(led, robot, TOLERANCE_M)
    shift = 0.5 * (len(smooth.q) - len(raw.q)) * 0.028
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 4.8), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        curves: list[tuple[Setpoints, float, str, Any]] = [
            (raw, 0.0, "as led", COLOURS[1]),
            (smooth, -shift, f"within {1e3 * TOLERANCE_M:g} mm", COLOURS[0]),
        ]
        for motion, begins, label, colour in curves:
            q = np.degrees(motion.q[:, ELBOW])
            above.plot(motion.t + begins, q, color=colour, linewidth=1.2, label=label)
            below.plot(motion.t[1:] + begins, np.diff(q) / 0.028, color=colour, linewidth=1.2)
        above.set_ylabel("elbow (deg)")
        below.set_ylabel("speed (deg/s)")
        below.set_xlabel("time (s)")
        above.legend(frameon=False)
        above.set_title("An elbow that a trembling hand leads out and back", pad=8)
    return figure


if __name__ == "__main__":
    led_picture(led_run()).savefig(PICTURE, dpi=DPI)
