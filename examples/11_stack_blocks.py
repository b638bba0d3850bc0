"""Two blocks are stacked: six position equations, and no frame computed by hand.

Hayward & Paul 1986, section 2.2.2, after the language AL: ARM = FINAL_PLACE TOP1 GRASP2 follows from the layout alone.
Move a block by changing its transform; everything that depends on it moves along.
"""

from qrobot import rccl
from qrobot.rccl import EQ, TL, gentr_rot, gentr_trsl, makeposition, t6, yunit

e = gentr_trsl("E", 0, 0, 100)
table = gentr_rot("TABLE", 500, 50, -300, yunit, 180)  # z points down
block1 = gentr_trsl("BLOCK1", 0, 0, -20)
block2 = gentr_trsl("BLOCK2", 0, 100, -20)
final_place = gentr_trsl("FINAL_PLACE", -80, 60, -20)
top1 = gentr_trsl("TOP1", 0, 0, -40)  # of block 1, seen from its grasp
grasp = gentr_trsl("GRASP", 0, 0, 0)

with rccl.control("puma560") as arm:
    task = [
        (makeposition("get_block1", t6, e, EQ, table, block1, grasp, TL, e), arm.CLOSE),
        (makeposition("place_block1", t6, e, EQ, table, final_place, grasp, TL, e), arm.OPEN),
        (makeposition("get_block2", t6, e, EQ, table, block2, grasp, TL, e), arm.CLOSE),
        (makeposition("stack_block2", t6, e, EQ, table, final_place, top1, grasp, TL, e), arm.OPEN),
    ]
    arm.setmode("cartesian")
    arm.setvel(300, 90)
    for position, hand in task:
        arm.distance("dz", -60.0)  # from above
        arm.move(position)
        arm.move(position)
        arm.waitfor(arm.completed)
        hand()
        print(f"{position.name}: {hand.__name__.lower()}s the hand")
        arm.distance("dz", -60.0)
        arm.move(position)
    arm.move(arm.pose("park"))
    arm.waitfor(arm.completed)
