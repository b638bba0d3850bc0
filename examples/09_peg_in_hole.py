"""A peg is put into a hole with loose clearance; where the hole is, the program knows to some millimetres.

Hayward & Paul 1986, section 2.4, name it as what their PUMA could do. The peg comes down while the arm gives way to the
sides: its round end slides into the mouth, and the hole leads it. A force limit guards the way down.

    qrobot run --lockstep examples/09_peg_in_hole.py
"""

import sys

# /// script
# [tool.qrobot]
# scene = "peg"
# ///
from qrobot import rccl
from qrobot.rccl import EQ, TL, gentr_rot, gentr_trsl, makeposition, t6, yunit

DEPTH = 26.0  # mm
error_x, error_y = (float(sys.argv[1]), float(sys.argv[2])) if len(sys.argv) == 3 else (4.0, 2.0)  # mm

e = gentr_trsl("E", 0, 0, 156.25)  # to the end of the peg
hole = gentr_rot("HOLE", 500 - error_x, -error_y, -300, yunit, 180)
p = makeposition("P", t6, e, EQ, hole, TL, e)

with rccl.control("puma560") as arm:
    arm.setmode("cartesian")
    arm.setvel(200, 90)
    arm.distance("dz", -20.0)
    arm.move(p)
    arm.waitfor(arm.completed)
    arm.comply("fx fy", 0.0, 0.0)
    arm.setvel(20, 90)
    arm.limit("fz", 60.0)  # N
    arm.distance("dz", DEPTH)
    p.end = 0
    arm.move(p)
    arm.waitfor(p.end)
    if p.code == rccl.Termination.COMPLETED:
        print(f"the peg is {DEPTH:.0f} mm down")
    else:
        print(f"the peg met something: {rccl.Termination(p.code).name}")
    arm.lock("fx fy")
    arm.setvel(50, 90)
    arm.distance("dz", -40.0)
    arm.move(p)
    arm.waitfor(arm.completed)
