"""Friction of the drives as linear in its parameters, the same model as the servo compensates.

Motor i, turning at r_i' in joint units, loses viscous r_i' plus the Coulomb friction of its direction, which grows
linearly within the robot file's `friction_velocity` of standstill.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

FRICTION_NAMES: Final = ("viscous", "coulomb_pos", "coulomb_neg")


def friction_columns(rate: Floats, transition: Floats) -> Floats:
    """What multiplies viscous friction and the two of Coulomb.

    Args:
        rate: of the motors in joint units, rad/s (m/s). Shape (m, n).
        transition: speed at which Coulomb friction is whole. Shape (n,).

    Returns:
        Shape (m, n, 3).
    """
    share = np.clip(rate / transition, -1.0, 1.0)
    return np.stack([rate, np.maximum(share, 0.0), np.minimum(share, 0.0)], axis=-1)
