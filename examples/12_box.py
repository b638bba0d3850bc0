"""All twelve edges of a box, traced by the tip of the tool on straight lines, its corners rounded.

What demonstrations of RCCL show first, here to be seen as well as watched: `--output` writes down the way that was
asked for and the one that was measured.

    qrobot run --output out/box examples/12_box.py
    qrobot run --output out/box examples/12_box.py 300      # mm/s instead of 150
"""

import sys

from qrobot import rccl
from qrobot.rccl import EQ, TL, gentr_rot, gentr_trsl, makeposition, t6, yunit

WIDTH, DEPTH, HEIGHT = 200.0, 150.0, 120.0  # mm
ROUND = "BCDA abcda bBCcdDA"  # capitals are corners below, small letters those above them; from A every edge once
MAX = 4  # motions that wait
SPEED = float(sys.argv[1]) if len(sys.argv) > 1 else 150.0  # mm/s

e = gentr_trsl("E", 0, 0, 100)  # the tool's tip on the last link
table = gentr_rot("TABLE", 500, -100, -300, yunit, 180)  # its z axis points down: up is -z
places = {"A": (0, 0), "B": (0, WIDTH), "C": (-DEPTH, WIDTH), "D": (-DEPTH, 0)}


def corner(letter):
    """The position of a corner."""
    x, y = places[letter.upper()]
    z = 0.0 if letter.isupper() else -HEIGHT
    return makeposition(letter, t6, e, EQ, table, gentr_trsl(f"CORNER {letter}", x, y, z), TL, e)


corners = {letter: corner(letter) for letter in "ABCDabcd"}

with rccl.control("puma560") as arm:
    arm.move(arm.pose("park"))
    arm.move(corners["A"])
    arm.setmode("cartesian")
    arm.setvel(SPEED, 90)
    arm.waitfor(corners["A"].end)
    started = arm.time
    for letter in ROUND.replace(" ", ""):
        arm.waitas(lambda: arm.nbrequest < MAX)
        arm.move(corners[letter])
    arm.waitfor(arm.completed)
    print(f"a box of {DEPTH:.0f} by {WIDTH:.0f} by {HEIGHT:.0f} mm in {(arm.time - started) / 1000:.1f} s")
