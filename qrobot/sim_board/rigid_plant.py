"""The arm as rigid bodies and nothing else: no contact, several times faster than MuJoCo, for campaigns of many runs.

The equations are a CasADi expression of the robot file (`codegen.rigid_body`), compiled once per robot and kept in the
cache. The step is MuJoCo's "Euler", semi-implicit, so that the two plants agree:

    v <- v + dt M(q)^-1 (torque - bias(q, v)),    q <- q + dt v

Time step, gravity and payload are constants of the plant, not of the expression. Friction, brakes and motors are those
of `drive`.
"""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.codegen import QUICK_EXPRESSIONS, CompiledFunction, compile_function
from qrobot.codegen.compile import default_cache_dir
from qrobot.config import Robot
from qrobot.errors import ConfigError
from qrobot.sim_board.plant import Plant, plant_step, step_plant

_ROUNDING: Final = 1e-9  # a flat body is on the bound
_STEPS: Final[dict[tuple[Path, bytes], CompiledFunction]] = {}  # by cache folder and all that is known of the arm


class RigidPlant:
    """Owner of a rigid-body plant.

    Args:
        robot: the arm.
        dt: time step, s.
        gravity_factor: on the robot file's gravity.
        payload_kg: point mass at the flange.

    Raises:
        ConfigError: the robot's masses or inertias are none that bodies have.
        CodegenError: the cache folder cannot be written.
    """

    def __init__(self, robot: Robot, dt: float, gravity_factor: float = 1.0, payload_kg: float = 0.0) -> None:
        _check_inertias(robot)
        self.plant: Plant = Plant(
            step=plant_step(_step(robot).kernel),
            handles=np.zeros(0, np.int64),
            constants=np.array([dt, *(robot.geometry.gravity_m_s2 * gravity_factor), payload_kg]),
            q=np.zeros(robot.n),
            v=np.zeros(robot.n),
            torque=np.zeros(robot.n),
        )
        self._try(robot)

    def place(self, q: Floats) -> None:
        """Put the arm at `q` (n,) at rest."""
        self.plant.q[:] = q
        self.plant.v[:] = 0.0
        self.plant.torque[:] = 0.0

    def _try(self, robot: Robot) -> None:
        self.place(robot.poses["ready"])
        step_plant(self.plant)
        if not np.isfinite(self.plant.v).all():
            raise ConfigError(f"{robot.name} cannot be simulated: its first step is not finite")


def _step(robot: Robot) -> CompiledFunction:
    """One step of the arm; that of an arm equal in everything is used again, for to write it down takes 50 ms."""
    key = default_cache_dir(), pickle.dumps(robot)
    if key not in _STEPS:
        from qrobot.codegen.rigid_body import euler_step  # loads CasADi

        overwritten = {"q_next": "q", "v_next": "v"}
        _STEPS[key] = compile_function(euler_step(robot), in_place=overwritten, expressions=QUICK_EXPRESSIONS)
    return _STEPS[key]


def _check_inertias(robot: Robot) -> None:
    """No body has a principal inertia above the sum of the others; with one the equations may have no solution."""
    largest, total = robot.links.inertia.max(axis=1), robot.links.inertia.sum(axis=1)
    impossible = largest > total - largest + _ROUNDING * total
    if impossible.any():
        names = ", ".join(np.array(robot.joint_names)[impossible])
        raise ConfigError(f"{robot.name} cannot be simulated: links of {names} have an inertia no body has")
