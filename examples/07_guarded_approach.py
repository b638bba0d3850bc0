"""A table of unknown height is felt, and the world model learns where it is.

Hayward & Paul 1986, sections 3.2 and 3.3: a motion ends when the arm exerts too much (`limit`), `update` gives a
transform the value it must have, and the arm then presses on what it has found (`comply`). Where nothing stands the
motion ends at its goal, and the program says so.

    qrobot run --lockstep examples/07_guarded_approach.py
"""

# /// script
# [tool.qrobot]
# scene = "table"
# ///

from qrobot import rccl
from qrobot.rccl import EQ, TL, gentr_rot, gentr_trsl, hold, makeposition, newtrans, t6, yunit

PRESS = 20.0  # N

e = gentr_trsl("E", 0, 0, 156.25)  # to the end of the probe
guess = gentr_rot("GUESS", 500, 0, -260, yunit, 180)  # about here, 40 mm too high
table = newtrans("TABLE", hold)  # where it really is, relative to the guess
p = makeposition("P", t6, e, EQ, guess, table, TL, e)

with rccl.control("puma560") as arm:
    arm.setmode("cartesian")
    arm.setvel(200, 90)
    arm.distance("dz", -30.0)
    arm.move(p)
    arm.setvel(20, 90)
    arm.limit("fz", 15.0)  # N
    arm.distance("dz", 80.0)  # farther than any table
    arm.update(table, p)
    p.end = 0
    arm.move(p)
    arm.waitfor(p.end)  # above
    arm.waitfor(p.end)  # at the table, or below where it should be
    if p.code == rccl.Termination.FORCE_LIMIT:
        print(f"the table is {table.p.z:.1f} mm below the guess")
        arm.waitfor(arm.completed)
        arm.comply("fz", PRESS)
        arm.setime(200, 400)
        arm.move(p)
        arm.waitfor(p.end)
        begin = arm.time
        arm.waitas(lambda: arm.time > begin + 2000)
        print(f"pressed with {PRESS:.0f} N for two seconds")
        arm.lock("fz")
    else:
        print("there is no table")
    arm.setvel(200, 90)
    arm.distance("dz", -50.0)
    arm.move(p)
    arm.waitfor(arm.completed)
