"""Two arms grasp an object that a camera tracks, and carry it together (Multi-RCCL; Lloyd et al. 1987, section 3.4).

The object has a frame of its own with one path; both arms keep constant offsets to it. Here the camera is a function.

    qrobot run --offline examples/22_two_hands.py                            # two ideal arms
    qrobot run --lockstep --deployment two_arms examples/22_two_hands.py     # two emulated ones, on virtual time
    qrobot up two_arms & python examples/22_two_hands.py                     # the same in real time
"""

import numpy as np

from qrobot.multi_rccl import (
    EQ,
    TL,
    TRANS,
    grasp,
    maintain,
    make_position,
    move,
    open_hand,
    rccl_control,
    rccl_open,
    setvel,
    stop,
    tracking_mode,
    wait_as,
    wait_for,
)
from qrobot.rccl import gentr_rpy, gentr_trsl, newtrans, trsl

seen = [0]  # samples of the camera


def track(t):
    """The object as the camera sees it: it drifts along, ever more slowly."""
    seen[0] += 1
    trsl(t, 500 - 60 * np.exp(-0.01 * seen[0]), 0, 20)


loc = newtrans("LOC", track)
cam = gentr_trsl("CAM", 0, 0, 0)
upright = gentr_rpy("UPRIGHT", 0, 0, 0, 0, 180, 0)  # its z axis points down, as a tool's
tool1, tool2 = gentr_trsl("TOOL1", 0, 0, 150), gentr_trsl("TOOL2", 0, 0, 150)
coord1 = gentr_trsl("COORD1", 0, 0, 0)  # the world in the base of either arm: face to face, a metre apart
coord2 = gentr_rpy("COORD2", 1000, 0, 0, 180, 0, 0)
disp1, disp2 = gentr_trsl("DISP1", 0, 100, 0), gentr_trsl("DISP2", 0, -100, 0)

obj = rccl_open("OBJECT_FRAME")
rccl_control(obj)
maintain(obj, make_position(cam, TRANS, EQ, loc, upright, TL, TRANS))

robot1 = rccl_open("left", "puma560", "127.0.0.1:5600")
robot2 = rccl_open("right", "puma560", "127.0.0.1:5601")
for robot in (robot1, robot2):
    rccl_control(robot)
p1 = make_position(TRANS, tool1, EQ, coord1, obj.trans, disp1, TL, tool1)
p2 = make_position(TRANS, tool2, EQ, coord2, obj.trans, disp2, TL, tool2)
for robot, p in ((robot1, p1), (robot2, p2)):
    tracking_mode(robot)
    move(robot, p)
wait_for(robot1.completed)  # each goes on tracking while the other is under way
wait_for(robot2.completed)
grasp(robot1)
grasp(robot2)
print(f"both hands hold the object at x = {obj.trans.p.x:.1f} mm")

lifted = gentr_rpy("LIFTED", 480, 60, 150, 20, 170, 0)
setvel(obj, 100, 30)
move(obj, make_position(TRANS, EQ, lifted, TL, TRANS))
stop(obj, make_position(TRANS, EQ, cam, lifted, disp1, TL, TRANS), 500)


left, right = {}, {}  # hands in the world as they were measured, by the number of the sample. Shapes (4, 4)


def look():
    """Measure both hands; two arms are measured at one instant where their samples have one number."""
    for hands, coord, robot, tool in ((left, coord1, robot1, tool1), (right, coord2, robot2, tool2)):
        hands[robot.sample] = np.linalg.inv(coord.value) @ robot.channel.measured_t6 @ tool.value
    return obj.completed.count


wait_as(look)
apart = [np.linalg.norm((np.linalg.inv(left[n]) @ right[n])[:3, 3]) for n in sorted(left.keys() & right.keys())]
print(f"carried along one path; the hands came {1e3 * np.ptp(apart):.2f} mm closer or farther apart meanwhile")
open_hand(robot1)
open_hand(robot2)
