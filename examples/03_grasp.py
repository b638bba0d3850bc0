"""S-02: a grasp in three steps: 10 mm above, down, and the hand closes in the middle of a 400 ms dwell.

Hayward & Paul 1986, section 3.3. The same position serves all three motions; `distance` modifies the goal of the first.
"""

from qrobot import rccl
from qrobot.rccl import EQ, TL, gentr_rot, gentr_trsl, makeposition, t6, yunit

e = gentr_trsl("E", 0, 0, 100)
part = gentr_rot("PART", 500, 100, -300, yunit, 180)
p = makeposition("P", t6, e, EQ, part, TL, e)

with rccl.control("puma560") as arm:
    arm.OPEN()
    arm.setmode("cartesian")
    arm.setvel(200, 90)
    p.end = 0  # reset the count
    arm.distance("dz", -10.0)  # back up 10 mm along the tool
    arm.move(p)
    arm.move(p)
    arm.setime(0, 400)
    arm.move(p)  # stay there
    arm.waitfor(p.end)
    print(f"above the part at {arm.time:.0f} ms")
    arm.waitfor(p.end)
    print(f"at the part at {arm.time:.0f} ms")
    arm.waitas(lambda: p.scal > 0.5)
    print(f"hand closed at {arm.time:.0f} ms")
    arm.CLOSE()
    arm.waitfor(arm.completed)
    print(f"done at {arm.time:.0f} ms")
