"""Two arms share a place: whichever holds the semaphore may enter (Corke & Kirkham, section 2.7).

The generator asks EVENT_DEQ before a motion begins. Answered with MOVE_STOP the arm stays where it is, and the
generator asks again. `qrobot run --offline` moves two arms on one time. Arms that run, and those of `qrobot run
--lockstep --deployment two_arms`, are named behind the program by their bridges: 127.0.0.1:5600 127.0.0.1:5601.
"""

import sys

from qrobot.arcl import (
    ARCL_ARGCV,
    ARCL_BRIDGE,
    ERROR,
    EVENT_DEQ,
    EVENT_DONE,
    MOV_NOTIFY,
    MOV_SHARE,
    MOVE_STOP,
    OK,
    ami_treal,
    arcl_close,
    arcl_open,
    joint_pos,
    move,
    new_sem,
    robot_pos,
    sem_give,
    sem_take,
)

SHARED = (20.0, 100.0, -20.0, 0.0, 60.0, 0.0)  # degrees
sem_excl = new_sem("shared place")
inside = {"who": None}


def excl_proc(event, rp):
    """Enter the shared place only when nobody is there."""
    if event == EVENT_DEQ:
        if sem_take(sem_excl) == ERROR:
            return MOVE_STOP
        inside["who"] = rp
        print(f"{ami_treal(rp) / 1000:6.2f} s: arm {arms.index(rp) + 1} enters")
    elif event == EVENT_DONE and rp is inside["who"]:
        print(f"{ami_treal(rp) / 1000:6.2f} s: arm {arms.index(rp) + 1} is done")
        inside["who"] = None
        sem_give(sem_excl)
    return OK


first, second = [word for word in sys.argv if ":" in word] or ("", "")
arms = [
    arcl_open(ARCL_ARGCV, len(sys.argv), sys.argv, ARCL_BRIDGE, first, 0),
    arcl_open(ARCL_BRIDGE, second, 0),
]
for rp in arms:
    move(rp, robot_pos(rp, "park"), MOV_SHARE, 30, 0)
    move(rp, joint_pos(rp, "shared", SHARED), MOV_NOTIFY, excl_proc, 0)
    move(rp, robot_pos(rp, "park"), 0)
for rp in arms:
    arcl_close(rp)
