"""S-04: the arm moves until somebody hits return, and where it was then is put into the world model.

Hayward & Paul 1986, section 3.3. `update` solves the equation for LOC with the measured T6 when the motion is
interrupted.
"""

from qrobot import rccl
from qrobot.rccl import EQ, TL, YES, gentr_rot, gentr_trsl, makeposition, t6, yunit

e = gentr_trsl("E", 0, 0, 100)
ref = gentr_rot("REF", 500, 50, -300, yunit, 180)
loc = gentr_trsl("LOC", 0, 200, 0)
p = makeposition("P", t6, e, EQ, ref, loc, TL, e)

with rccl.control("puma560") as arm:
    arm.move(arm.pose("park"))
    arm.waitfor(arm.completed)
    arm.setmode("cartesian")
    arm.setvel(40, 30)
    arm.update(loc, p)
    arm.move(p)
    input("hit <return> to stop the arm\n")
    arm.nextmove(YES)
    arm.waitfor(arm.completed)
    if p.code != YES:
        print("The arm was in P when <return> was hit")
    print(f"LOC is now {loc.p.x:.1f} {loc.p.y:.1f} {loc.p.z:.1f} mm")
