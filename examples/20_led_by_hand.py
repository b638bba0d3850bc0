"""Play again what a hand has led the arm through: smoothed, joined, and slower where the hand was too fast.

The files come from `qrobot guide`. Without any the program makes two of its own, with the trembling of a hand.

    qrobot run --lockstep examples/20_led_by_hand.py
    qrobot run examples/20_led_by_hand.py first.csv second.csv
"""

import sys
from math import pi, sin
from pathlib import Path

import numpy as np

from qrobot import rccl
from qrobot.rccl.recordings import joined, smoothed
from qrobot.rccl.setpoint_tables import read_setpoint_table
from qrobot.rccl.setpoints import Setpoints

TOLERANCE = 0.003  # m, at the flange and 100 mm beside it
SAMPLES = 150  # of 28 ms
TREMBLING = 0.002  # rad


def led(start, way):
    """A motion from `start` along `way`, rad, as a hand would lead it."""
    rows = []
    for k in range(SAMPLES):
        s = k / (SAMPLES - 1)
        eased = s * s * (3 - 2 * s)
        rows.append(start + eased * way + TREMBLING * sin(pi * s) * sin(0.9 * k) * np.ones(len(start)))
    return Setpoints("puma560", 28_000, np.array(rows))


with rccl.control("puma560") as arm:
    here = np.array(arm.how.q_setpoint)
    away = np.array([0.3, 0.1, 0.2, -0.2, 0.3, 0.1])
    parts = [read_setpoint_table(Path(name), arm.robot) for name in sys.argv[1:]]
    parts = parts or [led(here, away), led(here + 1.2 * away, -1.2 * away)]
    lesson = joined([smoothed(part, arm.robot, TOLERANCE) for part in parts], arm.robot)
    print(f"{len(parts)} recordings, joined {lesson.t[-1]:.1f} s")
    if np.abs(lesson.q[0] - here).max() > 1e-6:
        arm.move(rccl.Position("first", lesson.q[0]))
        arm.waitfor(arm.completed)
    arm.play(lesson)
    arm.waitfor(arm.completed)
    print(f"back within {np.degrees(np.abs(np.array(arm.how.q_setpoint) - lesson.q[-1]).max()):.3f} deg of its end")
