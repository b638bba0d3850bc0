"""S-06: a crank is turned four times; where its shaft is, the program knows only roughly.

Hayward & Paul 1986, section 3.4.2. Two opposite rotations carry the controlled frame round the shaft: TL names the
handle, so its x axis always points to the shaft, and the arm gives way along it; the goal is exact along the way round
alone. The paper's hand holds the handle; here a rod stands in its hole and is pressed down a little.

    qrobot run --lockstep examples/08_crank.py
"""

# /// script
# [tool.qrobot]
# scene = "crank"
# ///

from qrobot import rccl
from qrobot.rccl import EQ, TL, gentr_rot, gentr_trsl, makeposition, newtrans, rot, t6, yunit, zunit

TURNS = 4
ERROR = 6.0  # mm by which the program is wrong about the shaft


def forth(t):
    """The crank's angle; `scal` runs from 0 to 1 during the motion."""
    rot(t, zunit, turn.scal * 360.0 * TURNS)


def back(t):
    """The opposite, so that the tool does not turn: the handle's z axis points down, the shaft's up."""
    rot(t, zunit, turn.scal * 360.0 * TURNS)


e = gentr_trsl("E", 0, 0, 156.25)  # to the end of the rod
shaft = gentr_trsl("SHAFT", 500 + ERROR, 0, -300)
handle = gentr_rot("HANDLE", 100, 0, -10, yunit, 180)  # its z points down, its x to the shaft
hole = gentr_rot("HOLE", 600, 0, -310, yunit, 180)  # this one the program knows
rotp, rotn = newtrans("ROTP", forth), newtrans("ROTN", back)
get = makeposition("GET", t6, e, EQ, hole, TL, e)
turn = makeposition("TURN", t6, e, EQ, shaft, rotp, handle, rotn, TL, handle)

with rccl.control("puma560") as arm:
    arm.setmode("cartesian")
    arm.setvel(200, 90)
    arm.distance("dz", -40.0)
    arm.move(get)
    arm.setvel(20, 90)
    arm.move(get)
    arm.waitfor(arm.completed)
    arm.comply("fx fz", 0.0, 10.0)
    arm.setime(200, 4000 * TURNS)
    begin = arm.time
    arm.move(turn)
    arm.waitfor(turn.end)
    if turn.code == rccl.Termination.COMPLETED:
        print(f"turned {TURNS} times in {(arm.time - begin) / 1000:.1f} s")
    else:
        print(f"the crank was lost, code {turn.code}")
    arm.lock("fx fz")
    arm.setvel(50, 90)
    arm.distance("dz", -40.0)
    arm.move(get)  # depart
    arm.waitfor(arm.completed)
