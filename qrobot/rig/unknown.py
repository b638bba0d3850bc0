"""Arms nobody has been told of: what identification and adaptation are tried on.

Mass, centre and friction of every link are drawn within a share of the robot file, and something is in the hand. A body
keeps its shape: its inertia grows with its mass.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from qrobot.config import Robot
from qrobot.ident.friction import FRICTION_NAMES
from qrobot.ident.regressor import Regressor, known_parameters
from qrobot.sim_board.emulator import Emulator

Floats = NDArray[np.float64]

SPREAD: Final = 0.3
LARGEST_LOAD_KG: Final = 2.5


@dataclass(frozen=True, eq=False)
class UnknownArm:
    """An arm as it is: `robot` with `payload_kg` at the flange."""

    robot: Robot
    payload_kg: float

    @classmethod
    def drawn(cls, robot: Robot, seed: int) -> UnknownArm:
        """An arm of the kind of `robot`; the same seed gives the same."""
        random, links = np.random.default_rng(seed), robot.links
        low, high = 1.0 - SPREAD, 1.0 + SPREAD
        mass = random.uniform(low, high, robot.n)
        changed = {
            "mass": links.mass * mass,
            "com": links.com * random.uniform(low, high, links.com.shape),
            "inertia": links.inertia * mass[:, None],
        }
        name = robot.control.friction_preset
        preset = robot.friction[name]
        rubs = {kind: getattr(preset, kind) * random.uniform(low, high, robot.n) for kind in FRICTION_NAMES}
        friction = {**robot.friction, name: preset.model_copy(update=rubs)}
        other = robot.model_copy(update={"links": links.model_copy(update=changed), "friction": friction})
        return cls(other, float(random.uniform(0.0, LARGEST_LOAD_KG)))

    def emulator(self) -> Emulator:
        """The arm behind an emulated board."""
        return Emulator(self.robot, payload_kg=self.payload_kg)

    def parameters(self, regressor: Regressor) -> Floats:
        """True link parameters of a gravity regressor, load included. Shape (p,)."""
        theta, robot = known_parameters(self.robot, regressor), self.robot
        theta[-4:] += self.payload_kg * np.array([1.0, 0.0, 0.0, robot.geometry.flange_m])
        return theta

    @property
    def friction(self) -> Floats:
        """Viscous and Coulomb friction of each motor. Shape (n, 3)."""
        preset = self.robot.friction[self.robot.control.friction_preset]
        return np.column_stack([getattr(preset, kind) for kind in FRICTION_NAMES])

    @property
    def told(self) -> Robot:
        """The robot file of somebody who knows everything: the load is part of the last link."""
        links, load = self.robot.links, self.payload_kg
        mass, com = links.mass.copy(), links.com.copy()
        mass[-1] += load
        at_flange = np.array([0.0, 0.0, self.robot.geometry.flange_m])
        com[-1] = (links.mass[-1] * com[-1] + load * at_flange) / mass[-1]
        everywhere = {"gravity_joints": np.ones(self.robot.n, dtype=np.bool_)}
        control = self.robot.control.model_copy(update=everywhere)
        known = links.model_copy(update={"mass": mass, "com": com})
        return self.robot.model_copy(update={"links": known, "control": control})
