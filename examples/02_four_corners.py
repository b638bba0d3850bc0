"""S-01: a square traced four times in Cartesian mode, the program keeping pace with the corners.

Hayward & Paul 1986, section 3.3. All sixteen motions are queued at once; the first corner's `end` counts how often the
arm passed it. Run it with `qrobot run --lockstep examples/02_four_corners.py`.
"""

from qrobot import rccl
from qrobot.rccl import EQ, TL, gentr_rot, gentr_trsl, makeposition, t6, yunit

ROUNDS = 4

e = gentr_trsl("E", 0, 0, 100)  # the tool's tip on the last link, mm
table = gentr_rot("TABLE", 500, 50, -300, yunit, 180)  # its z axis points down: the tool stands upright on it
corners = [gentr_trsl(f"CORNER{i}", x, y, 0) for i, (x, y) in enumerate([(0, 0), (0, 150), (-100, 150), (-100, 0)])]
p = [makeposition(f"P{i}", t6, e, EQ, table, corner, TL, e) for i, corner in enumerate(corners)]

with rccl.control("puma560") as arm:
    arm.move(arm.pose("park"))
    arm.setmode("cartesian")
    arm.setvel(200, 90)  # mm/s and degrees/s
    for _ in range(ROUNDS):
        for corner in p:
            arm.move(corner)
    print(f"{arm.nbrequest} motions wait")
    for n in range(1, ROUNDS + 1):
        arm.waitfor(p[0].end)
        print(f"starting square {n} at {arm.time / 1000:.2f} s")
    arm.waitfor(arm.completed)
    print(f"done; corners passed {[corner.end.count for corner in p]} times since somebody waited")
