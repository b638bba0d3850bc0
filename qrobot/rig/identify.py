"""Record a plan in lock-step: an emulated arm makes its moves, by the library every program uses."""

from __future__ import annotations

from qrobot.config import Robot
from qrobot.ident.excitation import Excitation
from qrobot.ident.perform import MoveProgress, perform
from qrobot.ident.plan import ExcitationPlan
from qrobot.rig.fallen_arm import control_at_rest
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.memory.telemetry import Rows
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.wire.vocabulary import DEFAULT_PERIOD_US


def record_lockstep(
    robot: Robot,
    robot_file: str,
    settings: ServoSettings,
    emulator: Emulator,
    plan: ExcitationPlan | Excitation,
    progress: MoveProgress = lambda _number, _move: None,
    period_us: int = DEFAULT_PERIOD_US,
    first: int = 0,
) -> Rows:
    """Telemetry of an emulated arm that makes the moves of a plan, shape (rows,).

    Args:
        robot: as the servo believes it to be.
        robot_file: its name or file, as a program has it.
        settings: of the servo.
        emulator: the arm as it is.
        plan: made for the robot.
        progress, first: see `perform`.
        period_us: sample period of the program.

    Raises:
        ServoFault: the servo stopped the arm.
    """
    rig = LockstepRig(robot, settings, emulator)
    with control_at_rest(rig, robot_file, period_us) as arm:
        perform(arm, robot, plan, progress, first)
    return rig.rows()
