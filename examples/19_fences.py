"""A fence refuses a motion before it begins, and ends another one at a sample, where its goal has moved too near.

The fences are those of a deployment file. Without them the arm would go down to the end of its reach.

    qrobot run --offline --deployment examples/19_fences.toml examples/19_fences.py
    qrobot up examples/19_fences.toml & qrobot run --deployment examples/19_fences.toml examples/19_fences.py
"""

from qrobot import rccl
from qrobot.errors import FenceCrossed
from qrobot.motion import Termination
from qrobot.rccl import EQ, TL, gentr_rot, gentr_trsl, makeposition, newtrans, t6, yunit

SINKING = 30.0  # mm/s

with rccl.control("puma560") as arm:
    above = gentr_rot("ABOVE", 550, 0, 0, yunit, 180)
    depth = gentr_trsl("DEPTH", 0, 0, 300)  # the bench begins there
    flange = newtrans("FLANGE", "const")

    def sink(t):
        """How far a lift has gone down; it starts with the program."""
        t.p.z = SINKING * arm.time / 1000.0

    over = makeposition("OVER", t6, flange, EQ, above, TL, flange)
    into = makeposition("INTO", t6, flange, EQ, above, depth, TL, flange)
    lift = makeposition("LIFT", t6, flange, EQ, above, newtrans("SINK", sink), TL, flange)

    arm.setmode("cartesian")
    arm.setvel(200, 90)
    arm.move(over)
    arm.waitfor(arm.completed)
    try:
        arm.move(into)
    except FenceCrossed as error:
        print(f"refused: {error.body} would come {error.depth_m * 1000:.1f} mm too near {error.fence}")
    else:
        print("not refused: no fence is known; name their file with --deployment examples/19_fences.toml")

    arm.move(lift)
    arm.move(lift)
    arm.waitfor(arm.completed)
    arm.waitas(lambda: lift.code != Termination.COMPLETED)  # until then the arm goes down with the lift
    print(f"{Termination(lift.code).name}: the arm stopped, the lift {SINKING * arm.time / 1000:.0f} mm down")
    arm.move(over)
    arm.waitfor(arm.completed)
