"""Least squares that are linear in most unknowns: variable projection (Golub and Pereyra 1973).

For every x the best linear values c are solved for, so that only x is searched: by Levenberg and Marquardt's method,
with Kaufman's derivative (1975), which takes the change of c along.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import IdentificationError

_STEPS: Final = 100
_SETTLED: Final = 1e-10  # relative change of the cost
_FIRST_DAMPING: Final = 1e-3
_LAST_DAMPING: Final = 1e8  # where nothing helps
_EASE: Final = 3.0
_TIGHTEN: Final = 4.0


class Separable(Protocol):
    """A model A(x) c of m rows."""

    def columns(self, x: Floats) -> Floats:
        """A. Shape (m, p)."""

    def slope(self, x: Floats, c: Floats) -> Floats:
        """Derivative of A c by x at fixed c. Shape (m, k)."""


@dataclass(frozen=True, eq=False)
class Projected:
    """Values c (p,) that fit best at x (k,), what is left (m,), and the covariance of c and x at unit deviation."""

    x: Floats
    c: Floats
    residual: Floats
    covariance: Floats


def fit_separable(model: Separable, b: Floats, weight: Floats, believed: Floats, doubt: float) -> Projected:
    """x and c of A(x) c = b.

    Args:
        model: of the rows.
        b: shape (m,).
        weight: one over the deviation of each row. Shape (m,).
        believed: x, as it is thought beforehand, where the search begins. Shape (k,).
        doubt: deviation of that; what the rows do not tell of x stays there.

    Raises:
        IdentificationError: the columns do not determine c.
    """
    search = _FrictionSearch(model, b, weight, believed, doubt)
    damping, at = _FIRST_DAMPING, search.point(believed)
    if at is None:
        raise IdentificationError("the rows do not determine every value: record more speeds and poses")
    for _ in range(_STEPS):
        change, expected = search.change(at, damping)
        tried = search.point(at.x + change)
        if tried is None or tried.cost > at.cost:
            damping *= _TIGHTEN
        else:
            expected, at, damping = 1.0 - tried.cost / max(at.cost, 1e-300), tried, damping / _EASE
        if expected < _SETTLED or damping > _LAST_DAMPING:
            break
    return Projected(at.x, at.c, at.left / weight, search.covariance(at))


@dataclass(frozen=True, eq=False)
class _Point:
    """Weighted columns, their Gram matrix, best values, what they leave, and the cost of it all, at x."""

    x: Floats
    A: Floats
    gram: Floats
    c: Floats
    left: Floats
    cost: float


@dataclass(frozen=True, eq=False)
class _FrictionSearch:
    model: Separable
    b: Floats
    weight: Floats
    believed: Floats
    doubt: float

    def point(self, x: Floats) -> _Point | None:
        """The best values at x; none where its columns depend on each other."""
        A = self.model.columns(x) * self.weight[:, None]
        gram, weighted = A.T @ A, self.weight * self.b
        try:
            c: Floats = np.linalg.solve(gram, A.T @ weighted).astype(np.float64)
        except np.linalg.LinAlgError:
            return None
        left, off = weighted - A @ c, (x - self.believed) / self.doubt
        return _Point(x, A, gram, c, left, float(left @ left + off @ off))

    def change(self, at: _Point, damping: float) -> tuple[Floats, float]:
        """The next step of x, and the share of the cost it is expected to save."""
        S = self._slope(at)
        J = S - at.A @ np.linalg.solve(at.gram, at.A.T @ S)
        squares = J.T @ J + np.eye(at.x.size) / self.doubt**2
        pull = J.T @ at.left - (at.x - self.believed) / self.doubt**2
        change: Floats = np.linalg.solve(squares + damping * np.diag(np.diag(squares)), pull).astype(np.float64)
        return change, float(change @ pull) / max(at.cost, 1e-300)

    def covariance(self, at: _Point) -> Floats:
        """Covariance of c and x together, for rows with unit deviation. Shape (p + k, p + k)."""
        J = np.column_stack([at.A, self._slope(at)])
        information = J.T @ J
        k = at.x.size
        information[-k:, -k:] += np.eye(k) / self.doubt**2
        lengths = np.sqrt(np.diag(information))
        return np.asarray(np.linalg.inv(information / np.outer(lengths, lengths)) / np.outer(lengths, lengths))

    def _slope(self, at: _Point) -> Floats:
        return self.model.slope(at.x, at.c) * self.weight[:, None]
