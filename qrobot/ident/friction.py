"""Friction of the drives as linear in its parameters, the same model as the servo compensates.

Motor i, turning at r_i' in joint units, loses viscous r_i' plus the Coulomb friction of its direction, which grows
linearly within the robot file's `friction_velocity` of standstill.

A drive that sticks rubs more than that when it is slow, by an excess that fades with speed, as
1 / (1 + (v / v_s)^2) (Hess and Soom 1990). Far above v_s that falls with the square of speed, nearly whatever v_s is:
one number for each direction tells what is left of it, its remainder at one speed.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arrays import Floats

FRICTION_NAMES: Final = ("viscous", "coulomb_pos", "coulomb_neg")
REMAINDER_NAMES: Final = ("remainder_pos", "remainder_neg")
REMAINDER_SPEED: Final = 0.1  # of a joint's greatest speed, at which the remainder is told: that of the plan's swings
BELIEVED: Final = 0.02  # v_s over a joint's greatest speed, until slow samples tell


def friction_columns(rate: Floats, transition: Floats) -> Floats:
    """Columns of viscous friction and the two of Coulomb.

    Args:
        rate: of the motors in joint units, rad/s (m/s). Shape (m, n).
        transition: speed at which Coulomb friction is whole. Shape (n,).

    Returns:
        Shape (m, n, 3).
    """
    share = np.clip(rate / transition, -1.0, 1.0)
    return np.stack([rate, np.maximum(share, 0.0), np.minimum(share, 0.0)], axis=-1)


def remainder_columns(rate: Floats, v_max: Floats) -> Floats:
    """Columns of the remainders of Stribeck's excess in either direction.

    Args:
        rate: of the motors in joint units, rad/s (m/s). Shape (m, n).
        v_max: greatest speeds of the joints. Shape (n,).

    Returns:
        Shape (m, n, 2).
    """
    faded = 1.0 + (rate / (BELIEVED * v_max)) ** 2
    share = np.sign(rate) * (1.0 + (REMAINDER_SPEED / BELIEVED) ** 2) / faded
    return np.stack([np.maximum(share, 0.0), np.minimum(share, 0.0)], axis=-1)
