"""One arm mirrors another every 4 ms, by a compiled control function that never waits for the interpreter.

As in `16_mirror.py` a master moves its arm and posts where the arm was measured, and a slave sends its own arm to the
mirror image of that, to which it goes first. What lies between, here the image, smoothed and no faster than joints may
go, is a task on the processor "compiled": the three share an array of numbers.

    qrobot run --offline examples/27_compiled_mirror.py                           # two ideal arms
    qrobot run --lockstep --deployment two_arms examples/27_compiled_mirror.py    # two emulated ones, on virtual time
    qrobot up two_arms & python examples/27_compiled_mirror.py                    # the same in real time
"""

import numpy as np

from qrobot.rci import (
    rci_clock,
    rci_close,
    rci_control,
    rci_create,
    rci_descriptor,
    rci_get_memory,
    rci_onclock,
    rci_robot,
    rci_shared_memory,
    rci_start,
    rci_wait,
)
from qrobot.realtime.jit import lean_kernel

PERIOD = 4  # ticks of 1 ms
SAMPLES = 400  # of the swing, there and back
SWING = np.radians([5.0, 3.0, -4.0, 2.0, 4.0, -3.0])
MIRROR = np.array([-1.0, 1.0, 1.0, -1.0, 1.0, -1.0])  # joints 1, 4 and 6 turn the other way
SMOOTH_MS = 30  # two bridges have clocks of their own: one run finds nothing new, and the next one twice as much
SHARE = 0.3  # of the joints' speed: in real time three runs may fall between two samples of the slave
STATE, POSTED, MIRRORS = 0, 1.0, 2.0  # a word: the master's joints stand there; the slave is where it should be
MASTER, SLAVE, FARTHEST = 1, 7, 13  # joints of the master, setpoints of the slave, its longest step; six words each
rests, ways = {}, {}  # where the master stood; the way of the slave to its first place
swung = [0]  # samples
behind = [0.0]  # the slave's largest distance from the mirror image


@lean_kernel
def mirror(_tick, memory):
    """Bring the setpoints of the slave nearer to the mirror image of the master."""
    if memory[STATE] == MIRRORS:
        for j in range(6):
            step, farthest = MIRROR[j] * memory[MASTER + j] - memory[SLAVE + j], memory[FARTHEST + j]
            memory[SLAVE + j] += max(-farthest, min(step * PERIOD / (SMOOTH_MS + PERIOD), farthest))


def numbers():
    """The memory of the task "mirror"."""
    return rci_get_memory("mirror").view(np.float64)


def master(td):
    """Post the measured joints; swing, gently at both ends, once the slave mirrors."""
    rest, memory = rests.setdefault("master", np.array(td.how.q_setpoint)), numbers()
    swung[0] += memory[STATE] == MIRRORS
    share = 0.5 * (1.0 - np.cos(2.0 * np.pi * min(swung[0] / SAMPLES, 1.0)))
    td.chg.go_to(tuple((rest + share * SWING).tolist()))
    memory[MASTER:SLAVE] = td.how.q
    memory[STATE] = max(memory[STATE], POSTED)


def slave(td):
    """Go to the mirror image of where the master stands; then where the compiled function says, while it runs."""
    if not rci_descriptor("mirror").active:
        raise RuntimeError("nothing tells the slave where to go")
    memory = numbers()
    if not memory[STATE]:
        return
    goal = MIRROR * memory[MASTER:SLAVE]
    if memory[STATE] == POSTED:
        memory[SLAVE:FARTHEST], there = ways.setdefault("slave", Way(td, goal)).at(td.runs)
        memory[FARTHEST:] = SHARE * td.robot.limits.v_max * PERIOD * 1e-3
        if there:
            memory[STATE] = MIRRORS
    else:
        behind[0] = max(behind[0], np.abs(goal - td.how.q).max())
    td.chg.go_to(tuple(memory[SLAVE:FARTHEST].tolist()))


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
left, right, between = rci_create("left", priority=1), rci_create("right"), rci_create("mirror", "compiled")
rci_shared_memory("mirror", 8 * (FARTHEST + 6), between, left.bit | right.bit)
for task, function in ((left, master), (right, slave), (between, mirror)):
    rci_control(task, function)
    rci_onclock(task, PERIOD)
rci_start(left.bit | right.bit | between.bit)
rci_wait(lambda: swung[0] > SAMPLES + 20)
print(
    f"the slave was at most {np.degrees(behind[0]):.2f} degrees behind; it ends at {np.degrees(right.how.q).round(1)}"
)
rci_close()
