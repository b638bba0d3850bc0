"""A tool above a table that it comes down on, in lock-step."""

from __future__ import annotations

import numpy as np

from qrobot.arrays import Floats
from qrobot.config.scene import Scene
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.mujoco_plant import PlantMemory
from tests.support.dead_encoder import TABLE
from tests.support.pressing import tip_down
from tests.support.puma import ROBOT
from tests.support.puma import arm as puma

TOP, X = -0.3, 0.5  # m
ABOVE, BELOW = 0.05, 0.05  # m, where the motion begins, and where it would end
SCENE = Scene(kind="table", position_m=(X, 0.0, TOP))
BEGIN, END = (tip_down(X, 0.0, TOP + height, SCENE) for height in (ABOVE, -BELOW))


class Table(LockstepRig):
    """A table, and an arm above it whose program is to go straight down into it; each so many cycles are noted."""

    def __init__(self, every: int = 1) -> None:
        self.every = every
        self.forces: list[float] = []
        self.setpoints: list[Floats] = []
        super().__init__(
            ROBOT, ServoSettings(rate_hz=1000.0, calibration=TABLE), Emulator(ROBOT, start=BEGIN, scene=SCENE)
        )

    @property
    def plant(self) -> PlantMemory:
        """Arm and table."""
        plant = self.emulator.plant
        assert isinstance(plant, PlantMemory)
        return plant

    def ticks(self, n: int) -> None:
        """So many cycles, some by some."""
        for begin in range(0, n, self.every):
            super().ticks(min(self.every, n - begin))
            self.forces.append(float(np.linalg.norm(self.plant.contact_force())))
            self.setpoints.append(np.array(self.mailbox.snapshot().q_setpoint))

    def tip_m(self) -> float:
        """Height of the tool's tip above the table by the measured joints."""
        T = puma().forward(np.array(self.mailbox.snapshot().q))
        return float(T[2, 3] + T[2, 2] * (ROBOT.geometry.flange_m + SCENE.tool.length_m)) - TOP

    def take_table_away(self) -> None:
        """Nothing is in the way any more."""
        self.plant.model.geom_contype[:] = self.plant.model.geom_conaffinity[:] = 0
