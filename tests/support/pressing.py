"""An arm in a scene, held by springs at its joints, and poses with the tool pointing down."""

from __future__ import annotations

import mujoco
import numpy as np

from qrobot.arrays import Floats
from qrobot.config.scene import Scene
from qrobot.model.transform import transform
from qrobot.sim_board.mujoco_plant import PlantMemory, load_plant
from tests.support.puma import ROBOT, arm

DT = 0.00025
DOWN = np.diag([1.0, -1.0, -1.0])
STIFFNESS = np.array([4000.0, 4000.0, 4000.0, 400.0, 400.0, 400.0])


def tip_down(x: float, y: float, z: float, scene: Scene) -> Floats:
    """Joint positions with the tip of the tool at (x, y, z) in the base frame, m, pointing down. Shape (6,)."""
    wrist = z + scene.tool.length_m + ROBOT.geometry.flange_m
    solution: Floats = arm().nearest(transform(DOWN, [x, y, wrist]), ROBOT.poses["park"])
    return solution


class HeldArm:
    """A plant whose joints are pulled to `goal` by springs, their weight carried."""

    def __init__(self, scene: Scene, q: Floats, sensed: bool = False) -> None:
        self.plant: PlantMemory = load_plant(ROBOT, DT, scene=scene, sensed=sensed)
        self.scene, self.goal = scene, q.copy()
        self.plant.place(q)

    def run(self, seconds: float) -> HeldArm:
        """So much time passes."""
        data, n = self.plant.data, self.goal.size
        for _ in range(round(seconds / DT)):
            pull = STIFFNESS * (self.goal - data.qpos[:n]) - 0.06 * STIFFNESS * data.qvel[:n]
            data.qfrc_applied[:n] = data.qfrc_bias[:n] + pull
            mujoco.mj_step(self.plant.model, data)
        return self

    def to(self, goal: Floats, seconds: float, steps: int = 50) -> HeldArm:
        """Move the springs' other end evenly."""
        start = self.goal.copy()
        for share in np.linspace(0.0, 1.0, steps + 1)[1:]:
            self.goal = start + share * (goal - start)
            self.run(seconds / steps)
        return self

    @property
    def tip(self) -> Floats:
        """End of the tool in the base frame, m. Shape (3,)."""
        tool = self.plant.data.body("tool")
        base = np.array([0.0, 0.0, ROBOT.geometry.base_height_m])
        end: Floats = tool.xpos + tool.xmat.reshape(3, 3)[:, 2] * self.scene.tool.length_m - base
        return end
