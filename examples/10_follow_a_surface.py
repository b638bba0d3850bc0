"""A proximity sensor keeps the tool at its distance from a surface that nobody has measured.

Hayward & Paul 1986, section 3.4.1: a functional transform adds up what the sensor says is wrong, and stands in the
equation like any other. The sensor here is made up: it looks at a wavy table through the arm's own kinematics.
"""

import math

import numpy as np

from qrobot import rccl
from qrobot.config import load_robot
from qrobot.model.arm import Arm
from qrobot.rccl import EQ, TL, gentr_rot, gentr_trsl, makeposition, newtrans, t6, yunit

OFFSET = 20.0  # mm, distance to keep
GAIN = 0.2  # of what is wrong, made good in each sample
RANGE = 2.0  # mm, more than that the sensor does not tell

kinematics = Arm(load_robot("puma560"))
e = gentr_trsl("E", 0, 0, 100)
table = gentr_rot("TABLE", 500, 50, -300, yunit, 180)  # z points down, into the table


def surface(y):
    """How deep the surface is below the table's frame at y, mm; only the sensor knows."""
    return 5.0 * math.sin(y / 20.0)


with rccl.control("puma560") as arm:

    def gap():
        """What a sensor at the tip would measure: its distance to the surface, mm."""
        tip = np.linalg.inv(table.value) @ kinematics.forward(np.array(arm.how.q)) @ e.value
        return surface(1000.0 * tip[1, 3]) - 1000.0 * tip[2, 3]

    def sensfn(t):
        """Go down by a part of what the tool is too high."""
        t.p.z += GAIN * min(max(gap() - OFFSET, -RANGE), RANGE)

    sens = newtrans("SENS", sensfn)
    begin = makeposition("BEGIN", t6, e, EQ, table, gentr_trsl("OVER", 0, 0, -20), sens, TL, e)
    end = makeposition("END", t6, e, EQ, table, gentr_trsl("DISP", 0, 100, -20), sens, TL, e)
    arm.setmode("cartesian")
    arm.setvel(100, 90)
    arm.move(begin)
    arm.waitas(lambda: begin.end.count > 0 and abs(gap() - OFFSET) < 0.5)  # the sensor has brought it there
    arm.setvel(25, 90)
    gaps = []
    arm.move(end)
    arm.waitas(lambda: gaps.append(gap()) or end.scal > 0.95)
    print(f"between {min(gaps):.1f} and {max(gaps):.1f} mm over a surface that goes up and down by 10")
    arm.move(arm.pose("park"))
    arm.waitfor(arm.completed)
