"""What the things around an emulated arm feel and do, by MuJoCo's own account."""

from __future__ import annotations

import mujoco
import numpy as np

from qrobot.sim_board.emulator import Emulator


def contact_force(emulator: Emulator) -> float:
    """Sum of the normal forces of all contacts, N."""
    memory = emulator.memory
    total = 0.0
    for i in range(memory.data.ncon):
        force = np.zeros(6)
        mujoco.mj_contactForce(memory.model, memory.data, i, force)
        total += float(force[0])
    return total


def crank_angle(emulator: Emulator) -> float:
    """How far the crank of a scene was turned, rad."""
    angle: float = emulator.memory.data.joint("crank").qpos[0]
    return angle
