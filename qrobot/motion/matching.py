"""Which joints give way for which axes: the joint matching of Paul and Shimano (1976), by relative gains.

With J the Jacobian in the controlled frame and G its inverse, the gain of joint j for axis c, relative to the gain it
has when all other axes are held, is J[c, j] G[j, c] (Bristol, "On a new measure of interaction for multivariable
process control", 1966); for several joints and axes it is det J[C, S] det G[S, C]. At 1 the joints serve their axes and
no others; near 0 they cannot move along them, far above 1 the others undo what they do, below 0 they turn it round.
"""

from __future__ import annotations

from itertools import combinations
from typing import Final

import numpy as np

from qrobot.errors import Singular
from qrobot.motion.limits import Floats

LEAST_FITNESS: Final = 0.1  # below it no joints are taken for the axes
KEPT_FITNESS: Final = 0.4  # joints once taken are kept as long as theirs is above it [A]
_REGULAR: Final = 1e-6

Joints = tuple[int, ...]


def fitness(J: Floats, axes: Joints, joints: Joints) -> float:
    """How well `joints` serve `axes`, 1 at best and 0 when they cannot. J has shape (6, n)."""
    G = np.linalg.pinv(J)
    gain = float(np.linalg.det(J[np.ix_(axes, joints)]) * np.linalg.det(G[np.ix_(joints, axes)]))
    if gain <= 0.0:
        return 0.0
    return min(gain, 1.0 / gain)


def match(J: Floats, axes: Joints) -> Joints:
    """The joints that give way for `axes`, in rising order, one for each. J has shape (6, n).

    Raises:
        Singular: no joints serve these axes in this pose.
    """
    n = J.shape[1]
    if np.linalg.svd(J, compute_uv=False)[-1] < _REGULAR or n < len(axes):
        raise Singular("no joint can be matched with a compliant axis at a singular pose")
    best = max(combinations(range(n), len(axes)), key=lambda joints: fitness(J, axes, joints))
    if fitness(J, axes, best) < LEAST_FITNESS:
        raise Singular("no joints move the controlled frame along its compliant axes without moving it along others")
    return best


def drift_step(J: Floats, axes: Joints, joints: Joints, error: Floats) -> Floats:
    """How far along `axes` the controlled frame is, all others held, when `joints` are off by `error` (k,).

    Shape (k,), m and rad: with the other axes held, joints move by G[S, C] times a motion along the axes (equation 16
    of Hayward & Paul 1986, solved so that the next solution has the compliant joints where they were found).
    """
    G = np.linalg.pinv(J)
    step: Floats = np.linalg.solve(G[np.ix_(joints, axes)], error)
    return step
