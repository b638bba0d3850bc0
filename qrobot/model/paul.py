"""The PUMA 560 in Paul's convention, as RCCL and ARCL programs see it: a view, tested, on the internal VAL convention.

    q_paul = q_val + (0, 180, 180, 0, 0, 180) deg        T_paul = rot_z(180 deg) @ T_val

Joint 1 turns the same way from the same zero, since Paul's base x axis points where VAL's points away: so the published
limits agree (J1 ±160, J2 -45..225, J3 -225..45 deg) and Paul's zero is a right arm where VAL's is a left one. With
another 180 degrees on joint 1 the base frames would coincide, as in Corke's map of the Robotics Toolbox models.
"""

from __future__ import annotations

import numpy as np

from qrobot.arrays import Floats
from qrobot.config.values import frozen
from qrobot.model.transform import transform

PAUL_OFFSET: Floats = frozen(np.radians([0.0, 180.0, 180.0, 0.0, 0.0, 180.0]))
T_PAUL_VAL: Floats = frozen(transform(np.diag([-1.0, -1.0, 1.0])))


def to_paul(q: Floats) -> Floats:
    """Paul's angles in (-180, 180] degrees, as rad, of VAL angles. Shapes (6,)."""
    turned: Floats = np.pi - np.mod(np.pi - (q + PAUL_OFFSET), 2.0 * np.pi)
    return turned


def from_paul(q_paul: Floats, q_min: Floats, q_max: Floats) -> Floats:
    """VAL angles of Paul's, by whole turns as near as possible to the middle of the joint ranges. Shapes (6,)."""
    q, middle = q_paul - PAUL_OFFSET, 0.5 * (q_min + q_max)
    centred: Floats = q + 2.0 * np.pi * np.round((middle - q) / (2.0 * np.pi))
    return centred


def pose_to_paul(T: Floats) -> Floats:
    """A pose in Paul's base frame of one in the internal base frame. Shapes (4, 4)."""
    return T_PAUL_VAL @ T


def pose_from_paul(T_paul: Floats) -> Floats:
    """A pose in the internal base frame of one in Paul's; half a turn is its own inverse. Shapes (4, 4)."""
    return T_PAUL_VAL @ T_paul
