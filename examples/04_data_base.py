"""S-03: one equation, many goals: a hold transform is read from a data base while the arm moves.

Hayward & Paul 1986, section 3.3. `move` copies the hold transform, so it can be read anew at once; `nbrequest` keeps
the queue short. How long a look-up takes does not matter: the arm never stops for it unless it is faster.
"""

from qrobot import rccl
from qrobot.rccl import EQ, NO, TL, YES, gentr_rot, gentr_trsl, hold, makeposition, newtrans, t6, trsl, yunit

MAX = 3
LOCATIONS = iter([(0, 0, 0), (0, 80, 0), (-60, 80, -30), (-60, 0, -30), (-30, 40, -60)])  # mm, in the part's frame


def gettr(transform):
    """Read the next location; NO when there is none."""
    location = next(LOCATIONS, None)
    if location is None:
        return NO
    trsl(transform, *location)
    return YES


e = gentr_trsl("E", 0, 0, 100)
ref = gentr_rot("REF", 500, 50, -300, yunit, 180)
loc = newtrans("LOC", hold)
p = makeposition("P", t6, e, EQ, ref, loc, TL, e)

with rccl.control("puma560") as arm:
    arm.setmode("cartesian")
    arm.setvel(150, 90)
    while gettr(loc) != NO:
        arm.waitas(lambda: arm.nbrequest < MAX)
        arm.move(p)
    arm.waitfor(arm.completed)
    print(f"{p.end.count} locations visited")
