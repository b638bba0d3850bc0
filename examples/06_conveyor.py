"""A belt as a functional transform: the tool comes down on a part that moves, and stays with it.

Hayward & Paul, "Introduction to RCCL", section 2.2.3. While nothing else waits the last equation remains true, so the
arm follows the belt until the next motion.
"""

from qrobot import rccl
from qrobot.rccl import EQ, TL, gentr_rot, gentr_trsl, makeposition, newtrans, t6, yunit

SPEED = 60.0  # mm/s

with rccl.control("puma560") as arm:

    def belt(t):
        """Where the belt is now; it starts with the program."""
        t.p.y = SPEED * arm.time / 1000.0

    conv = newtrans("CONV", belt)
    e = gentr_trsl("E", 0, 0, 100)
    base = gentr_rot("BASE", 500, -100, -300, yunit, 180)
    part = gentr_trsl("PART", 0, 0, 0)
    over = makeposition("OVER", t6, e, EQ, base, conv, part, TL, e)

    arm.setmode("cartesian")
    arm.setvel(200, 90)
    arm.distance("dz", -100.0)
    arm.move(over)
    arm.move(over)
    arm.waitfor(arm.completed)
    begin = arm.time
    arm.CLOSE()
    arm.waitas(lambda: arm.time > begin + 1000)
    print(
        f"with the belt for {arm.time - begin:.0f} ms, which moved {SPEED * (arm.time - begin) / 1000:.0f} mm meanwhile"
    )
    arm.move(arm.there)  # an absolute stop
    arm.waitfor(arm.there.end)
    arm.move(arm.pose("park"))
    arm.waitfor(arm.completed)
