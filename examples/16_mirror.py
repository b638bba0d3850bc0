"""One arm mirrors another: a master and a slave, two tasks of RCI on one clock.

The master's task moves its arm and posts where the arm was measured. The slave's task, which runs behind it at the same
tick, sends its own arm to the mirror image of that, left for right. First it goes to the mirror image of where the
master stands, wherever that is.

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
SMOOTH_MS = 30  # two bridges have clocks of their own: one sample finds nothing new, and the next one twice as much
SWING = np.radians([25.0, 15.0, -20.0, 10.0, 20.0, -15.0])
MIRROR = np.array([-1.0, 1.0, 1.0, -1.0, 1.0, -1.0])  # joints 1, 4 and 6 turn the other way
POSTED, MIRRORS = 1.0, 2.0  # state of what is shared: the master's joints stand there; the slave is where it should be
rests, ways = {}, {}  # where the master stood; the way of the slave to its first place
swung = [0]  # samples
behind = [0.0]  # the slave's largest distance from the mirror image


def shared():
    """State, and the master's joints. Shape (7,)."""
    return rci_get_memory("master").view(np.float64)


def master(td):
    """Post the measured joints; swing, gently at both ends, once the slave mirrors."""
    rest, memory = rests.setdefault("master", np.array(td.how.q_setpoint)), shared()
    swung[0] += memory[0] == MIRRORS
    share = 0.5 * (1.0 - np.cos(2.0 * np.pi * min(swung[0] / SAMPLES, 1.0)))
    td.chg.go_to(tuple((rest + share * SWING).tolist()))
    memory[:] = (max(memory[0], POSTED), *td.how.q)


def slave(td):
    """Go to the mirror image of where the master stands, and follow it from then on."""
    state, *q = shared()
    if not state:
        return
    goal = MIRROR * q
    if state == POSTED:
        place, there = ways.setdefault("slave", Way(td, goal)).at(td.runs)
        if there:
            shared()[0] = MIRRORS
    else:
        farthest = 0.9 * td.robot.limits.v_max * PERIOD * 1e-3
        step = (goal - td.chg.setpoints) * PERIOD / (SMOOTH_MS + PERIOD)
        place = td.chg.setpoints + np.clip(step, -farthest, farthest)
        behind[0] = max(behind[0], np.abs(goal - td.how.q).max())
    td.chg.go_to(tuple(place.tolist()))


class Way:
    """A way of the joints from where they stand, gentle at both ends, at half their speed and acceleration."""

    def __init__(self, td, goal):
        self.begin, self.start, self.goal = td.runs, np.array(td.chg.setpoints), goal
        way, limits = np.abs(goal - self.start), td.robot.limits
        seconds = np.pi * max((way / limits.v_max).max(), np.sqrt(way / limits.a_max).max())
        self.samples = max(1, int(np.ceil(seconds * 1e3 / PERIOD)))

    def at(self, run):
        """Where the joints are to be at a run of the task, and whether that is the end."""
        done = min((run - self.begin) / self.samples, 1.0)
        return self.start + 0.5 * (1.0 - np.cos(np.pi * done)) * (self.goal - self.start), done == 1.0


rci_clock(1000)
rci_robot("left", "puma560", "127.0.0.1:5600")
rci_robot("right", "puma560", "127.0.0.1:5601")
left, right = rci_create("left", priority=1), rci_create("right")
rci_shared_memory("master", 8 * 7, left, right.bit)
for task, function in ((left, master), (right, slave)):
    rci_control(task, function)
    rci_onclock(task, PERIOD)
rci_start(left.bit | right.bit)
rci_wait(lambda: swung[0] > SAMPLES + 20)
print(
    f"the slave was at most {np.degrees(behind[0]):.2f} degrees behind; it ends at {np.degrees(right.how.q).round(1)}"
)
rci_close()
