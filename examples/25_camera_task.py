"""A camera task beside RCCL: it sees a part on a belt now and then, and the arm follows what it makes of that.

RCI runs the program's own tasks beside RCCL's trajectory task (Lloyd, Parker and McClain 1987, section 4). At one
instant the camera comes first, for its priority; then the arm's sample, whose functional transform looks where the part
is; then the watch, which was created after `control()`. Off line and in lock-step that order is exact.

    qrobot run --offline examples/25_camera_task.py
    qrobot run --lockstep examples/25_camera_task.py
"""

import numpy as np

from qrobot import rccl
from qrobot.rccl import EQ, TL, gentr_rot, gentr_trsl, makeposition, newtrans, t6, yunit
from qrobot.rci import (
    rci_clock,
    rci_close,
    rci_control,
    rci_create,
    rci_descriptor,
    rci_onclock,
    rci_shared_memory,
    rci_start,
    rci_ticks,
    rci_wait,
)

SPEED = 60.0  # mm/s of the belt, which the program does not know
PIXEL = 0.5  # mm
TRUST, LEARN = 0.3, 0.05  # how far a picture corrects place and speed
START = -100.0  # mm along the base's y axis, where the belt begins
following, beside = [], []


def belt(seconds):
    """Where the part is, mm; nobody else knows."""
    return SPEED * seconds


def expected():
    """Where the part is by what the camera has seen so far, mm."""
    place, speed, seen_at = memory
    return place + speed * (rci_ticks() / 1000 - seen_at)


def look(td):
    """The camera's control function: a picture corrects what was expected."""
    now = rci_ticks() / 1000
    error = round(belt(now) / PIXEL) * PIXEL - expected()
    memory[:] = expected() + TRUST * error, memory[1] + (LEARN * error / 0.04 if td.runs else 0.0), now


def measure(_td):
    """The watch's control function: how far the tool is from the part, along the belt."""
    if following and rci_descriptor("puma560").active:
        beside.append(abs(1000 * arm.measured_t6[1, 3] - START - belt(rci_ticks() / 1000)))


def part(t):
    """A functional transform, at each sample of the arm: the part is where the camera makes it expected."""
    if not camera.active:
        raise RuntimeError("the camera has failed")  # which stops the arm
    t.p.y = expected()


rci_clock(1000)
with rccl.control("puma560") as arm:
    watch, camera = rci_create("watch"), rci_create("camera", priority=1)
    memory = rci_shared_memory("part", 24).view(np.float64)  # place, speed, and when they were so
    for task, function, interval in ((camera, look, 40), (watch, measure, 28)):
        rci_control(task, function)
        rci_onclock(task, interval)
    rci_start(camera.bit | watch.bit)
    rci_wait(lambda: camera.runs >= 50)
    print(f"after {camera.runs} pictures the belt goes at {memory[1]:.1f} mm/s")

    e = gentr_trsl("E", 0, 0, 100)
    base = gentr_rot("BASE", 500, START, -300, yunit, 180)
    over = makeposition("OVER", t6, e, EQ, base, newtrans("PART", part), TL, e)
    arm.setmode("cartesian")
    arm.setvel(200, 90)
    arm.distance("dz", -100.0)
    arm.move(over)
    arm.move(over)
    arm.waitfor(arm.completed)
    following.append(arm.time)
    arm.waitas(lambda: arm.time > following[0] + 1000)
    print(f"with the part for a second, {max(beside):.1f} mm from it at most")
    following.clear()
    arm.move(arm.there)  # an absolute stop
    arm.waitfor(arm.there.end)
    arm.move(arm.pose("park"))
rci_close()
