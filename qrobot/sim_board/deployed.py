"""The emulated board and arm that a deployment file describes."""

from __future__ import annotations

from typing import Literal

from qrobot.arrays import Floats
from qrobot.config import DeployedArm, Robot
from qrobot.config.deployment import BoardChoice
from qrobot.config.scene import SceneKind
from qrobot.errors import ConfigError
from qrobot.sim_board.board import BoardOptions
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.faults import FaultPlan
from qrobot.sim_board.mismatch import PlantMismatch


def board_options(choice: BoardChoice, robot: Robot) -> BoardOptions:
    """Options of an emulated board in a deployment file, and in the robot file where it has none."""
    return BoardOptions(
        revision_f=(choice.revision or robot.board.revision) == "F",
        adc_idle=choice.adc_idle == 1,
        index_idle=choice.index_idle == 1,
    )


def emulator_of_arm(
    arm: DeployedArm,
    robot: Robot,
    *,
    plant: Literal["nominal", "mismatched"] | None = None,
    calibrated: bool | None = None,
    scene: SceneKind | None = None,
    faults: FaultPlan | None = None,
    payload_kg: float = 0.0,
    start: Floats | None = None,
) -> Emulator:
    """The emulator of `arm`, with what overrides the file; `start` are joint positions, shape (n,), rad or m.

    Raises:
        ConfigError: the arm's drives close the position loop, which the emulated board has none for; or what
            `Emulator` raises.
    """
    choice = arm.board
    if choice.position_drives:
        raise ConfigError(f"the drives of {arm.name} are in position mode: the emulated board has none such")
    wrong = (plant or choice.plant) == "mismatched"
    around = choice.scene if scene is None else choice.scene.model_copy(update={"kind": scene})
    return Emulator(
        robot,
        mismatch=PlantMismatch.mismatched(robot.n) if wrong else PlantMismatch.nominal(robot.n),
        start=choice.start_pose if start is None else start,
        calibrated=choice.calibrated if calibrated is None else calibrated,
        options=board_options(choice, robot),
        seed=choice.seed,
        payload_kg=payload_kg,
        faults=faults,
        pots=choice.pots,
        scene=around,
        force_sensor=choice.force_sensor,
    )
