"""The inverse of a Jacobian matrix."""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import MotionError, Singular

_LEAST: Final = 1e-9  # smallest singular value over the largest of a matrix that is inverted


def inverse_jacobian(J: Floats) -> Floats:
    """Joint rates per velocity of T6, of `J` (6, n). Shape (n, 6). Raises Singular; MotionError: not six joints."""
    if J.shape != (6, 6):
        raise MotionError(f"a Jacobian of {J.shape[1]} joints has no inverse; six are needed")
    values = np.linalg.svd(J, compute_uv=False)
    if not values[-1] > _LEAST * values[0]:
        raise Singular("the Jacobian is singular here: some motion of T6 needs joints without bound")
    return np.array(np.linalg.inv(J), dtype=np.float64)
