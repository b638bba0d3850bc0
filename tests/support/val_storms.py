"""Storms on an arm in lock-step: somebody types anything at the monitor of VAL II, while the arm is disturbed.

A storm is drawn from its seed. Each command meets its disturbance at a drawn sample: a stop that an operator asks for,
arm power taken away, the emergency stop, a push on a joint, one so soft that it is a collision, from which the arm
goes back, a pause, another override, or Ctrl-C at the terminal. What has been disturbed is put right some samples
later, as by a person. In the end the monitor is put in order, and a program runs.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Final

import numpy as np

from qrobot import rci
from qrobot.errors import LinkError, ServoFault
from qrobot.rccl.connect import open_channel
from qrobot.rci.machine_choice import MachineChoice, use_machine
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.val.arcl_arm import arcl_arm
from qrobot.val.arm import ValArm
from qrobot.val.interpreter import Interpreter, RunState
from qrobot.val.monitor import ValMonitor
from qrobot.val.rccl_arm import RcclArm
from qrobot.val.source import read_source
from tests.support.puma import ROBOT

SAMPLE_US: Final = 28_000
BEYOND: Final = 0.02  # rad beyond a joint's range: the servo's error, and the way of a stop
PUSH_MICRO: Final = 60_000_000  # N m, on the shoulder or the elbow: far beyond what nobody commanded
SOFT_MICRO: Final = (0.75e6 * ROBOT.guard.unexplained_torque_or_default).astype(int)  # N m, on the same joints
FIRST: Final = "DO PARAMETER COLLISION = 50", "RETRACT 30"
PATIENCE: Final = 3000  # samples that a command may take before Ctrl-C ends it
TIMES_TO_PROCEED: Final = 3
SAMPLES_TO_REST: Final = 60  # of an arm that falls into its brakes
PROGRAMS: Final = """
.PROGRAM main
MOVE #a
MOVES #b
SIGNAL 2001
DEPART 30
BREAK
MOVE #c
DRIVE 1, 10, 50
.END
.PROGRAM endless
MOVE #a
MOVE #b
.END
.PROGRAM wrong
MOVE #b
x = 1/0
MOVE #a
.END
.PROGRAM check
MOVE #a
BREAK
.END
.LOCATIONS
#a 0 -45 180 0 45 0
#b 10 -50 175 5 50 5
#c -30 -40 170 0 40 -20
.END
"""
COMMANDS: Final = (
    *("EX main", "EX main,2", "EX endless,-1", "EX wrong", "XSTEP main", "NEXT", "PROCEED", "PROCEED", "PROCEED"),
    *("RETRY", "ABORT", "SPEED 20", "SPEED 100", "RETRACT 0"),
    *("DO MOVE #c", "DO MOVE #a", "DO DRIVE 2,-5,50", "WHERE", "STATUS"),
)


@dataclass
class Storm:
    """What one storm was, and what went wrong.

    Attributes:
        told: each command, the disturbance that it met, and its answer.
        wrong: what must not be; empty when all is well.
        lost: why control of the arm was lost; empty when it was not. Allowed while the program has the arm come to
            rest, a motion being stopped having no path to go back to; at any other time it is wrong.
    """

    told: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)
    lost: str = ""


class Weather:
    """Disturbs the arm of a rig at drawn samples, and puts it right again.

    Attributes:
        coming_to_rest: the program has stopped its motions, and the arm does not stand yet.
    """

    def __init__(self, rig: LockstepRig, drawn: random.Random, storm: Storm) -> None:
        self._rig, self._drawn, self._storm = rig, drawn, storm
        self._begins = self._ends = 0
        self._left = PATIENCE
        self.coming_to_rest = False
        self._cause: Callable[[], None] = lambda: None
        self._farthest = ROBOT.limits.q_max + BEYOND, ROBOT.limits.q_min - BEYOND

    def draw(self) -> str:
        """Draw what happens during the next command; gives its name."""
        name = self._drawn.choice(list(_CAUSES))
        self._cause = partial(_CAUSES[name], self._rig, self._drawn)
        self._begins = self._drawn.choice([1, 3, 12, 40, 90])
        self._ends = self._begins + self._drawn.choice([1, 5, 30])
        self._left = PATIENCE
        return f"{name} at {self._begins}"

    def calm(self) -> None:
        """Nothing more happens, and all is put right."""
        self._begins = self._ends = -1
        self._left = PATIENCE
        put_right(self._rig)

    def sample(self) -> None:
        """One sample has passed."""
        self._begins, self._ends, self._left = self._begins - 1, self._ends - 1, self._left - 1
        q = np.array(self._rig.mailbox.snapshot().q)
        if not ((q < self._farthest[0]) & (q > self._farthest[1])).all():
            self._storm.wrong.append(f"beyond the range: {np.degrees(q).round(2).tolist()}")
        if self._ends == 0:
            put_right(self._rig)
        if self._begins == 0:
            self._cause()
        if self._left == 0:
            raise KeyboardInterrupt


def put_right(rig: LockstepRig) -> None:
    """Release the emergency stop, take the hand away, and let motions go on."""
    rig.board.panel.estop = 0
    rig.board.panel.push[:] = 0
    rig.mailbox.request_pause(False)
    rig.mailbox.request_override(1.0)


def _estop(rig: LockstepRig, _drawn: random.Random) -> None:
    rig.board.panel.estop = 1


def _push(rig: LockstepRig, drawn: random.Random) -> None:
    rig.board.panel.push[drawn.choice([1, 2])] = drawn.choice([-1, 1]) * PUSH_MICRO


def _soft_push(rig: LockstepRig, drawn: random.Random) -> None:
    joint = drawn.choice([1, 2])
    rig.board.panel.push[joint] = drawn.choice([-1, 1]) * SOFT_MICRO[joint]


def _ctrl_c(_rig: LockstepRig, _drawn: random.Random) -> None:
    raise KeyboardInterrupt


_CAUSES: Final[dict[str, Callable[[LockstepRig, random.Random], None]]] = {
    "nothing": lambda _rig, _drawn: None,
    "stop": lambda rig, _drawn: rig.mailbox.request_stop(),
    "power off": lambda rig, _drawn: rig.mailbox.request_power_off(),
    "emergency stop": _estop,
    "push": _push,
    "soft push": _soft_push,
    "pause": lambda rig, _drawn: rig.mailbox.request_pause(True),
    "override": lambda rig, drawn: rig.mailbox.request_override(drawn.choice([0.1, 0.5])),
    "Ctrl-C": _ctrl_c,
}


@contextmanager
def arm_in_lockstep(rig: LockstepRig, library: str) -> Iterator[ValArm]:
    if library == "rccl":
        with open_channel(lambda hello: link_factory(rig, SAMPLE_US, hello), "puma560") as channel:
            yield RcclArm(channel)
        return
    chosen = use_machine(MachineChoice("bridge", None, ROBOT))
    with chosen, rci.use(partial(link_factory, rig, SAMPLE_US)), arcl_arm(ROBOT) as arm:
        yield arm


def storm(seed: int, library: str, commands: int) -> Storm:
    """One storm of so many commands, with RCCL or ARCL below the interpreter.

    Ends with all in order and a program that has run, or with `lost`.
    """
    drawn, found = random.Random(f"{library} {seed}"), Storm()
    rig = LockstepRig(
        ROBOT, ServoSettings(rate_hz=1000.0), Emulator(ROBOT, physics="rigid", seed=seed), keep_telemetry=False
    )
    try:
        with arm_in_lockstep(rig, library) as arm:
            _rage(rig, arm, drawn, found, commands)
    except (LinkError, ServoFault) as error:
        if not found.lost:
            found.wrong.append(f"lost at the end: {error}")
    return found


def _rage(rig: LockstepRig, arm: ValArm, drawn: random.Random, found: Storm, commands: int) -> None:
    weather, sample, stop = Weather(rig, drawn, found), arm.sample, arm.stop

    def sampled() -> None:
        sample()
        weather.coming_to_rest = weather.coming_to_rest and not arm.idle
        weather.sample()

    def stopped() -> None:
        weather.coming_to_rest = True
        stop()

    arm.sample, arm.stop = sampled, stopped  # type: ignore[method-assign]
    run = Interpreter(arm, lambda _line: None, lambda _question: "1")
    run.machine.load(read_source(PROGRAMS)[0])
    monitor = ValMonitor(run)
    found.told += [f"{line}: {monitor.obey(line)}" for line in FIRST]
    for line in drawn.choices(COMMANDS, k=commands):
        met = weather.draw()
        try:
            answer = _obeyed(monitor, line, f"{line} ({met})", found)
        except (LinkError, ServoFault) as error:
            found.lost = str(error)
            if not weather.coming_to_rest:
                found.wrong.append(f"lost: {error}")
            raise
        _check(run, answer, found)
    weather.calm()
    _put_in_order(monitor, run, found)


def _obeyed(monitor: ValMonitor, line: str, told: str, found: Storm) -> str:
    """The answer to a line. Raises LinkError, ServoFault: the arm is lost, and the storm over."""
    found.told.append(told)
    answer = monitor.obey(line)
    found.told[-1] += f": {answer}"
    return answer


def _check(run: Interpreter, answer: str, found: Storm) -> None:
    """A program that has not ended can be gone on with, or it is told why not."""
    if run.state is RunState.RUNNING:
        found.wrong.append(f"{answer!r} while it still runs")
    if run.state in (RunState.PAUSED, RunState.FAILED) and not run.message:
        found.wrong.append(f"{run.state.value}, and nobody is told why")


def _put_in_order(monitor: ValMonitor, run: Interpreter, found: Storm) -> None:
    """Lead the arm back to its path where it stands off, give up what is left, run a program, and leave."""
    for _ in range(TIMES_TO_PROCEED):
        if not run.machine.arm.off_path:
            break
        for _ in range(SAMPLES_TO_REST):
            run.machine.arm.sample()
        _obeyed(monitor, "PROCEED", "PROCEED", found)
    answer = ""
    for line in ("ABORT", "SPEED 100", "EX check"):
        answer = _obeyed(monitor, line, line, found)
    if answer != "completed":
        found.wrong.append(f"the last program: {answer}")
    monitor.obey("QUIT")
