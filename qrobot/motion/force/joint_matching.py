"""Matching of joints to compliant axes by relative gains (Paul and Shimano 1976).

With J the Jacobian in the controlled frame and G its inverse, the gain of joint j for axis c, relative to the gain it
has when all other axes are held, is J[c, j] G[j, c] (Bristol, "On a new measure of interaction for multivariable
process control", 1966); for several joints and axes it is det J[C, S] det G[S, C]. At 1 the joints serve their axes and
no others; near 0 they cannot move along them, far above 1 the others undo what they do, below 0 they turn it round.
"""

from __future__ import annotations

from itertools import combinations
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import Singular
from qrobot.model.solve import invert_into

LEAST_FITNESS: Final = 0.1  # below it no joints are taken for the axes
KEPT_FITNESS: Final = 0.4  # joints once taken are kept as long as theirs is above it [A]
_REGULAR: Final = 1e-6
_SINGULAR: Final = 1e-9  # determinant of the Jacobian (m^3) below which no inverse is tried

JointIndices = tuple[int, ...]


def inverse_of(J: Floats) -> Floats:
    """The inverse of a Jacobian, or what comes nearest to one. Shapes (6, n) and (n, 6)."""
    if J.shape[0] == J.shape[1]:
        inverse = np.empty_like(J)
        if abs(invert_into(J, np.empty_like(J), inverse)) >= _SINGULAR:
            return inverse
    return np.array(np.linalg.pinv(J), dtype=np.float64)


def fitness(J: Floats, G: Floats, axes: JointIndices, joints: JointIndices) -> float:
    """Fitness of `joints` for `axes`, 1 at best and 0 when they cannot serve; J (6, n), its inverse G (n, 6)."""
    if len(axes) == 1:
        gain = float(J[axes[0], joints[0]] * G[joints[0], axes[0]])
    else:
        gain = float(np.linalg.det(J[np.ix_(axes, joints)]) * np.linalg.det(G[np.ix_(joints, axes)]))
    if gain <= 0.0:
        return 0.0
    return min(gain, 1.0 / gain)


def match(J: Floats, G: Floats, axes: JointIndices) -> JointIndices:
    """The joints that give way for `axes`, in rising order, one for each; J (6, n), its inverse G (n, 6).

    Raises:
        Singular: no joints serve these axes in this pose.
    """
    n = J.shape[1]
    if np.linalg.svd(J, compute_uv=False)[-1] < _REGULAR or n < len(axes):
        raise Singular("no joint can be matched with a compliant axis at a singular pose")
    best = max(combinations(range(n), len(axes)), key=lambda joints: fitness(J, G, axes, joints))
    if fitness(J, G, axes, best) < LEAST_FITNESS:
        raise Singular("no joints move the controlled frame along its compliant axes without moving it along others")
    return best


def drift_step(G: Floats, axes: JointIndices, joints: JointIndices, error: Floats) -> Floats:
    """Displacement of the controlled frame along `axes`, all others held, when `joints` are off by `error` (k,).

    Shape (k,), m and rad: with the other axes held, joints move by G[S, C] times a motion along the axes (equation 16
    of Hayward & Paul 1986, solved so that the next solution has the compliant joints where they were found).
    """
    if len(axes) == 1:
        return np.array(error / G[joints[0], axes[0]], dtype=np.float64)
    return np.array(np.linalg.solve(G[np.ix_(joints, axes)], error), dtype=np.float64)
