"""Base parameters: the combinations of link parameters that torques can tell, found by numerical rank.

Columns of the stacked regressor W that depend on others cannot be told from them. Each column is taken in turn, the
most wanted first, and leads a base parameter unless it is a combination of those that lead already (Gautier 1991 does
the same by QR): W theta = W_lead beta with beta = K theta.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.ident.regressor import Regressor

_SAMPLES: Final = 100  # random states; twice as many change nothing
_DEPENDENT: Final = 1e-9  # of the longest column's length: rounding of well-scaled states is 1e-15
_LEAST: Final = 1e-5  # m/s2 (m2/s2), rms: shorter columns are the rounding of an upright joint's direction [A]
_NOTHING: Final = 1e-9  # coefficient of a parameter that takes no part


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """Combinations beta = K theta of link parameters.

    Attributes:
        names: of theta. p of them.
        leading: index into theta of what leads each combination. b of them.
        K: shape (b, p); 1 at the leading parameter.
    """

    names: tuple[str, ...]
    leading: tuple[int, ...]
    K: Floats

    @property
    def leaders(self) -> tuple[str, ...]:
        """Name of each combination: its leading parameter's."""
        return tuple(self.names[i] for i in self.leading)

    @property
    def unseen(self) -> tuple[str, ...]:
        """Parameters no torque depends on."""
        return tuple(name for name, used in zip(self.names, np.any(self.K != 0.0, axis=0), strict=True) if not used)

    def columns(self, Y: Floats) -> Floats:
        """Columns of the base parameters in a regressor of shape (..., p). Shape (..., b)."""
        return Y[..., list(self.leading)]

    def combination(self, index: int) -> str:
        """A base parameter in words: `hx2 + 0.4318 m3 + 0.4318 m4`."""
        row, lead = self.K[index], self.leading[index]
        others = [_term(row[i], self.names[i]) for i in np.flatnonzero(row) if i != lead]
        return " ".join([self.names[lead], *others])


def _term(factor: float, name: str) -> str:
    size = "" if abs(abs(factor) - 1.0) < _NOTHING else f"{abs(factor):.4g} "
    return f"{'-' if factor < 0.0 else '+'} {size}{name}"


def base_parameters(W: Floats, names: Sequence[str], order: Sequence[int] | None = None) -> BaseParameters:
    """The combinations that the rows of `W` (rows, p) can tell; none where no joint bears weight.

    Args:
        W: stacked regressor, at states that move everything.
        names: of its columns.
        order: columns in the order in which they may lead; default as they stand.
    """
    longest, leading = float(np.linalg.norm(W, axis=0).max()), []
    shortest = max(_DEPENDENT * longest, _LEAST * math.sqrt(len(W)))
    basis = np.zeros((len(W), 0))
    for column in range(len(names)) if order is None else order:
        rest = W[:, column] - basis @ (basis.T @ W[:, column])
        rest -= basis @ (basis.T @ rest)  # once more: the first pass leaves rounding behind
        length = np.linalg.norm(rest)
        if length > shortest:
            leading.append(int(column))
            basis = np.column_stack([basis, rest / length])
    K: Floats = np.linalg.lstsq(W[:, leading], W, rcond=None)[0].astype(np.float64)
    K[np.abs(K) < _NOTHING] = 0.0
    return BaseParameters(tuple(names), tuple(leading), K)


def base_of_robot(robot: Robot, regressor: Regressor, seed: int = 0) -> BaseParameters:
    """The base parameters of an arm, by random states within its limits.

    First moments and inertias lead, from the base outwards, and masses only where nothing else can: so a link's
    combination gathers what hangs on it.
    """
    random, limits = np.random.default_rng(seed), robot.limits
    q = random.uniform(limits.q_min, limits.q_max, (_SAMPLES, robot.n))
    v, a = random.uniform(-1.0, 1.0, (2, _SAMPLES, robot.n))
    W = regressor(q, v, a).reshape(_SAMPLES * robot.n, -1)
    masses_last = sorted(range(len(regressor.names)), key=lambda column: regressor.names[column].startswith("m"))
    return base_parameters(W, regressor.names, masses_last)
