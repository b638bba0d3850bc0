"""Places that somebody taught are visited one after the other: names come from a data base, the motion from here.

Hayward & Paul, "Introduction to RCCL", sections 4.2 and 4.3: `qrobot teach` records, a program reads.

    qrobot run examples/13_taught_places.py parts.db
"""

import sys

from qrobot import rccl
from qrobot.rccl import EQ, TL, DataBase, gentr_trsl, makeposition, t6

path = sys.argv[1] if len(sys.argv) > 1 else "taught.db"
places = DataBase(path)
if not places.names():
    sys.exit(f"{path} has no places: `qrobot teach {path}` records some")
e = gentr_trsl("E", 0, 0, 0)  # teaching records the last link: no tool

with rccl.control("puma560") as arm:
    arm.setmode("cartesian")
    arm.setvel(200, 90)
    for name in places.names():
        p = makeposition(name, t6, e, EQ, places.get(name), TL, e)
        arm.move(p)
        arm.waitfor(p.end)
        print(f"at {name} after {arm.time / 1000:.2f} s")
    arm.move(arm.pose("park"))
    arm.waitfor(arm.completed)
