"""`qrobot board`: an emulated TRC004 board with an arm behind it, as a process of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, choose_arm, robot_of_arm
from qrobot.cli.console import note


def board(
    deployment: str = DEFAULT_DEPLOYMENT,
    *,
    arm: str | None = None,
    plant: Literal["nominal", "mismatched"] | None = None,
    calibrated: Annotated[bool | None, Parameter(negative="--uncalibrated")] = None,
    fault: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    faults: Path | None = None,
) -> None:
    """Emulate a TRC004 board and the arm behind it, until Ctrl-C.

    The board lives in shared memory under the arm's name and runs on the wall clock, whoever connects or dies.

    Parameters
    ----------
    deployment
        Deployment file, or the name of a packaged one.
    arm
        Which arm of the file; may be left out when there is only one.
    plant
        Overrides the file: the robot file's own friction, gravity and torque, or one fixed draw of wrong ones.
    calibrated
        Overrides the file: counters hold the true position, or were zeroed where the arm stands.
    fault
        Something that breaks, times counted from the start: "encoder:2 stuck @5s +0.5s". May be given again.
        `qrobot inject --list` tells what can break; `qrobot inject` breaks it in a board that runs.
    faults
        TOML file with the keys `faults`, a list of such lines, and `seed`, of what is random in them.
    """
    from qrobot.sim_board.board import BoardOptions
    from qrobot.sim_board.emulator import Emulator
    from qrobot.sim_board.faults import FaultPlan
    from qrobot.sim_board.mismatch import PlantMismatch
    from qrobot.sim_board.server import serve

    chosen = choose_arm(deployment, arm)
    robot, choice = robot_of_arm(chosen), chosen.board
    plan = FaultPlan.load(faults) if faults else FaultPlan()
    wrong = (plant or choice.plant) == "mismatched"
    emulator = Emulator(
        robot,
        mismatch=PlantMismatch.mismatched(robot.n) if wrong else PlantMismatch.nominal(robot.n),
        start=choice.start_pose,
        calibrated=choice.calibrated if calibrated is None else calibrated,
        options=BoardOptions(revision_f=(choice.revision or robot.board.revision) == "F"),
        seed=choice.seed,
        faults=FaultPlan(plan.faults + FaultPlan.parse(fault).faults, plan.seed),
        pots=choice.pots,
    )
    serve(chosen.name, emulator, lambda: note(f"board of {chosen.name} ({robot.name}) runs"))
