"""An arm of Multi-RCCL goes round four places on a table that is turned meanwhile (Lloyd et al. 1987, section 3.2).

One position equation, whose P holds another place for each motion: what is asked for is kept until it is done. The
table is a functional transform: the arm goes by where it is now.

    qrobot run --offline examples/18_four_places.py
    qrobot run --lockstep examples/18_four_places.py
    qrobot up & python examples/18_four_places.py         the same in real time
"""

from qrobot.multi_rccl import EQ, TL, TRANS, make_position, move, rccl_control, rccl_open, setmode, setvel, wait_for
from qrobot.rccl import gentr_rot, gentr_trsl, newtrans, rot, trsl, yunit, zunit

PLACES = ((0, -60), (80, -60), (80, 60), (0, 60))
samples = [0]


def turn(t):
    """The table, which turns by 3 degrees a second."""
    samples[0] += 1
    rot(t, zunit, 0.003 * 28 * samples[0])


arm = rccl_open("puma560")
rccl_control(arm)
tool, table = gentr_trsl("TOOL", 0, 0, 100), gentr_rot("TABLE", 480, 60, -250, yunit, 180)  # z points down
p, turned = newtrans("P", "hold"), newtrans("TURNED", turn)
p0 = make_position(TRANS, tool, EQ, table, turned, p, TL, tool, name="P0")

setmode(arm, "cartesian")
setvel(arm, 120, 60)
for x, y in PLACES:
    trsl(p, x, y, 0)
    move(arm, p0)
for number in range(len(PLACES)):
    wait_for(p0.end)
    x, y = (arm.trans.value @ tool.value)[:2, 3] * 1e3
    print(f"place {number + 1}: x {x:.1f} y {y:.1f} mm")
