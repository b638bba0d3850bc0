"""What the things around an emulated arm feel and do, by MuJoCo's own account."""

from __future__ import annotations

import mujoco
import numpy as np

from qrobot.sim_board.emulator import Emulator


def contact_force(emulator: Emulator) -> float:
    """Sum of the normal forces of all contacts, N."""
    plant = emulator.plant
    total = 0.0
    for i in range(plant.data.ncon):
        force = np.zeros(6)
        mujoco.mj_contactForce(plant.model, plant.data, i, force)
        total += float(force[0])
    return total


def crank_angle(emulator: Emulator) -> float:
    """How far the crank of a scene was turned, rad."""
    angle: float = emulator.plant.data.joint("crank").qpos[0]
    return angle
