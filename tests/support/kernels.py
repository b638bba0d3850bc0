"""Compile what nearly every test calls, beside linting: workers would wait for it, or all do it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import Final

from qrobot import rccl
from qrobot.config import load_robot
from qrobot.hwif.board_memory import local_board_memory
from qrobot.rci import VirtualLink
from qrobot.rig.compile_ahead import compile_parts
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.laws.shipped import LAWS, find_law
from qrobot.servo.laws.trial import prove_finite
from qrobot.servo.process import daemon, guardian
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator, emulator_run
from tests.support.fake_robot import FakeRobot
from tests.support.servo_bench import ServoBench

ROBOT: Final = "puma560"
PERIOD_NS: Final = 1_000_000


def servo() -> None:
    """The cycle, which takes longer than all else."""
    ServoBench().hold()


def board() -> None:
    """The emulated board and its plant."""
    emulator, memory = Emulator(load_robot(ROBOT)), local_board_memory()
    emulator.connect(memory)
    emulator_run(emulator.bundle, memory, PERIOD_NS, 1)


def both() -> None:
    """Cycle and board in one loop, as every test in lock-step runs them."""
    LockstepRig(load_robot(ROBOT), ServoSettings()).ticks(1)


def ahead() -> None:
    """The parts of cycle and board that no other process compiles just now."""
    compile_parts(ROBOT)


def processes() -> None:
    """The loops of servo and guardian as processes: the first test on the wall clock would wait for them."""
    daemon.warm_up(load_robot(ROBOT), ServoSettings())
    guardian.warm_up()


def laws() -> None:
    """Every law that comes with the project."""
    robot = load_robot(ROBOT)
    for name in LAWS:
        prove_finite(find_law(name, robot), name, robot)


def motion() -> None:
    """What a program moves by."""
    robot = FakeRobot(tuple(load_robot(ROBOT).poses["park"]))
    with rccl.use(lambda hello: VirtualLink(hello, robot.transfer)):
        arm = rccl.control(ROBOT)
        arm.move(arm.pose("ready"))
        arm.release()


PARTS: Final[tuple[Callable[[], None], ...]] = servo, ahead, processes, laws, motion, board, both

if __name__ == "__main__":
    with ProcessPoolExecutor(2) as pool:
        for done in [pool.submit(part) for part in PARTS]:
            done.result()
