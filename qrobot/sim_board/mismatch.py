"""Distance of the emulated arm from the model that the controller believes in.

A controller that compensates friction and gravity with the very numbers the plant was built from proves nothing. The
mismatched plant is one fixed draw: every factor at its bound, its sign drawn. It is not a worst case.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from qrobot.config import Robot
from qrobot.config.identified import with_torque_scale

FRICTION_ERROR: Final = 0.30
GRAVITY_ERROR: Final = 0.05
TORQUE_ERROR: Final = 0.20
STICTION_FACTOR: Final = 1.3
DRAW: Final = 0  # seed of the published draw


@dataclass(frozen=True)
class PlantMismatch:
    """Factors on the plant's true parameters; arrays have one value per joint.

    Attributes:
        viscous: on viscous friction.
        coulomb_pos: on Coulomb friction of positive motion.
        coulomb_neg: on Coulomb friction of negative motion.
        torque_gain: on the torque a DAC word gives.
        gravity: on the gravity vector.
        stiction: break-away friction over Coulomb friction; 1 is no stiction.
    """

    viscous: NDArray[np.float64]
    coulomb_pos: NDArray[np.float64]
    coulomb_neg: NDArray[np.float64]
    torque_gain: NDArray[np.float64]
    gravity: float
    stiction: float

    @classmethod
    def nominal(cls, n: int) -> PlantMismatch:
        """The plant is what the robot file says, without stiction."""
        one = np.ones(n)
        return cls(one, one, one, one, 1.0, 1.0)

    @classmethod
    def mismatched(cls, n: int, seed: int = DRAW) -> PlantMismatch:
        """Friction off by 30 % per joint and sign, torque by 20 % per joint, gravity 5 % heavier, stiction 1.3."""
        signs = np.random.default_rng(seed).choice((-1.0, 1.0), size=(4, n))
        viscous, positive, negative = 1.0 + FRICTION_ERROR * signs[:3]
        torque = 1.0 + TORQUE_ERROR * signs[3]
        return cls(viscous, positive, negative, torque, 1.0 + GRAVITY_ERROR, STICTION_FACTOR)

    def told(self, robot: Robot) -> Robot:
        """The robot file of somebody who knows the plant, but for stiction: a robot file has none."""
        name = robot.control.friction_preset
        preset, geometry = robot.friction[name], robot.geometry
        rubs = {kind: getattr(preset, kind) * getattr(self, kind) for kind in ("viscous", "coulomb_pos", "coulomb_neg")}
        weight = {"gravity_m_s2": geometry.gravity_m_s2 * self.gravity}
        known = robot.model_copy(
            update={
                "friction": {**robot.friction, name: preset.model_copy(update=rubs)},
                "geometry": geometry.model_copy(update=weight),
            }
        )
        return with_torque_scale(known, 1.0 / self.torque_gain)
