"""One arm mirrors another: a master and a slave, two tasks of RCI on one clock.

The master's task moves its arm and posts where the arm was measured. The slave's task, which runs behind it at the same
tick, sends its own arm to the mirror image of that, left for right, no faster than its joints may go.

    qrobot run --offline examples/16_mirror.py                           # two ideal arms
    qrobot run --lockstep --deployment two_arms examples/16_mirror.py    # two emulated ones, on virtual time
    qrobot up two_arms & python examples/16_mirror.py                    # the same in real time
"""

import numpy as np

from qrobot.rci import (
    rci_clock,
    rci_close,
    rci_control,
    rci_create,
    rci_get_memory,
    rci_onclock,
    rci_robot,
    rci_shared_memory,
    rci_start,
    rci_wait,
)

PERIOD = 28  # ticks of 1 ms
SAMPLES = 300  # of the swing, there and back
SWING = np.radians([25.0, 15.0, -20.0, 10.0, 20.0, -15.0])
MIRROR = np.array([-1.0, 1.0, 1.0, -1.0, 1.0, -1.0])  # joints 1, 4 and 6 turn the other way
rests = {}  # where the master stood
behind = [0.0]  # the slave's largest distance from the mirror image


def master(td):
    """Swing, gently at both ends, and post the measured joints."""
    rest = rests.setdefault("master", np.array(td.how.q_setpoint))
    share = 0.5 * (1.0 - np.cos(2.0 * np.pi * min(td.runs / SAMPLES, 1.0)))
    td.chg.go_to(tuple((rest + share * SWING).tolist()))
    rci_get_memory("master").view(np.float64)[:] = (1.0, *td.how.q)


def slave(td):
    """Follow the mirror image of what the master has posted."""
    posted, *q = rci_get_memory("master").view(np.float64)
    if posted:
        goal, farthest = MIRROR * q, 0.9 * td.robot.limits.v_max * PERIOD * 1e-3
        step = np.clip(goal - td.chg.setpoints, -farthest, farthest)
        td.chg.go_to(tuple((td.chg.setpoints + step).tolist()))
        behind[0] = max(behind[0], np.abs(goal - td.how.q).max())


rci_clock(1000)
rci_robot("left", "puma560", "127.0.0.1:5600")
rci_robot("right", "puma560", "127.0.0.1:5601")
left, right = rci_create("left", priority=1), rci_create("right")
rci_shared_memory("master", 8 * 7, left, right.bit)
for task, function in ((left, master), (right, slave)):
    rci_control(task, function)
    rci_onclock(task, PERIOD)
rci_start(left.bit | right.bit)
rci_wait(lambda: left.runs > SAMPLES + 20)
print(
    f"the slave was at most {np.degrees(behind[0]):.2f} degrees behind; it ends at {np.degrees(right.how.q).round(1)}"
)
rci_close()
