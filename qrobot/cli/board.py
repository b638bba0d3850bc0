"""`qrobot board`: an emulated TRC004 board with an arm behind it, as a process of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, choose_arm, robot_of_arm
from qrobot.cli.board_check import check
from qrobot.cli.console import note
from qrobot.config.scene import SceneKind

app = App(name="board", help_format="plaintext", group_commands="Commands")
app.command(check)


@app.default
def board(
    deployment: str = DEFAULT_DEPLOYMENT,
    *,
    arm: str | None = None,
    plant: Literal["nominal", "mismatched"] | None = None,
    calibrated: Annotated[bool | None, Parameter(negative="--uncalibrated")] = None,
    fault: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    faults: Path | None = None,
    scene: SceneKind | None = None,
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
    scene
        Overrides the file: what stands around the arm. Its other settings are the file's.
    """
    from qrobot.sim_board.deployed import emulator_of_arm
    from qrobot.sim_board.faults import FaultPlan
    from qrobot.sim_board.server import serve

    chosen = choose_arm(deployment, arm)
    robot = robot_of_arm(chosen)
    plan = FaultPlan.load(faults) if faults else FaultPlan()
    plan = FaultPlan(plan.faults + FaultPlan.parse(fault).faults, plan.seed)
    emulator = emulator_of_arm(chosen, robot, plant=plant, calibrated=calibrated, scene=scene, faults=plan)
    serve(chosen.name, emulator, lambda: note(f"board of {chosen.name} ({robot.name}) runs"))
