"""Arms nobody has been told of: what identification and adaptation are tried on.

Mass, centre and friction of every link are drawn within a share of the robot file, something is in the hand, and the
motors may give more or less torque than they are asked for. A body keeps its shape: its inertia grows with its mass.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.config.identified import with_torque_scale
from qrobot.ident.friction import FRICTION_NAMES, REMAINDER_SPEED
from qrobot.ident.model import Identified
from qrobot.ident.regressor import Regressor, known_parameters
from qrobot.ident.unknowns import Unknowns
from qrobot.sim_board.drive import STRIBECK_FRACTION
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.mismatch import TORQUE_ERROR, PlantMismatch

SPREAD: Final = 0.3
LARGEST_LOAD_KG: Final = 2.5


@dataclass(frozen=True, eq=False)
class PerturbedArm:
    """An arm as it is.

    Attributes:
        robot: its true file, but for the torque of its motors.
        payload_kg: point mass at the flange.
        torque_gain: torque given over torque asked for, by motor. Shape (n,).
        stiction: friction at rest over Coulomb friction; 1 is no stiction.
    """

    robot: Robot
    payload_kg: float
    torque_gain: Floats
    stiction: float = 1.0

    @classmethod
    def drawn(cls, robot: Robot, seed: int, wrong_torque: bool = False, stiction: float = 1.0) -> PerturbedArm:
        """An arm of the kind of `robot`; the same seed gives the same, `wrong_torque` and `stiction` or not."""
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
        payload_kg = float(random.uniform(0.0, LARGEST_LOAD_KG))
        gain = random.uniform(1.0 - TORQUE_ERROR, 1.0 + TORQUE_ERROR, robot.n)
        return cls(other, payload_kg, gain if wrong_torque else np.ones(robot.n), stiction)

    def emulator(self) -> Emulator:
        """The arm behind an emulated board."""
        return Emulator(self.robot, mismatch=self._mismatch, payload_kg=self.payload_kg)

    def holding(self, payload_kg: float) -> PerturbedArm:
        """The same arm with another load."""
        return replace(self, payload_kg=payload_kg)

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

    def scale(self, robot: Robot) -> Floats:
        """Torque that each motor has to be commanded, with the robot file `robot`, for a torque of 1. Shape (n,)."""
        true = self.robot.transmission.dac_per_Nm / self.torque_gain
        return np.asarray(true / robot.transmission.dac_per_Nm)

    def gravity(self, found: Identified, q: Floats) -> Floats:
        """Torques that really hold the arm; see `Identified.gravity`. Shape (m, n)."""
        held = found.regressor(q) @ self.parameters(found.regressor)
        coupling = found.robot.transmission.coupling
        return np.asarray(held @ np.linalg.inv(coupling) * self.scale(found.robot) @ coupling)

    def truth(self, unknowns: Unknowns) -> Floats:
        """The true values, in the unit and the order in which they are found, of an arm without a load besides its own.

        Shape (p,).
        """
        scale, free = self.scale(unknowns.robot), list(unknowns.free)
        units = [scale[motor] for motor in range(unknowns.robot.n) if motor not in free]
        unit = float(units[0]) if len(units) == 1 else 1.0
        beta = unknowns.base.K @ self.parameters(unknowns.regressor)
        friction = scale[:, None] * self.friction
        faded = 1.0 + (REMAINDER_SPEED / STRIBECK_FRACTION) ** 2
        remainder = (self.stiction - 1.0) / faded * friction[:, 1:]
        return np.concatenate(
            [
                unit * beta,
                friction.ravel(),
                scale[free] / unit,
                remainder.ravel(),
                np.zeros(unknowns.robot.n + unknowns.n_terms),
            ]
        )

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
        return self._mismatch.told(self.robot.model_copy(update={"links": known, "control": control}))

    def with_known_torque(self, robot: Robot) -> Robot:
        """The robot file `robot` with the torque of this arm's motors, as somebody measured it."""
        return with_torque_scale(robot, 1.0 / self.torque_gain)

    @property
    def _mismatch(self) -> PlantMismatch:
        return replace(PlantMismatch.nominal(self.robot.n), torque_gain=self.torque_gain, stiction=self.stiction)
