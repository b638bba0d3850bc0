"""Weighted and robust linear least squares, with what is known about the result.

Rows come in classes (motors), each with a scatter of its own that the fit finds; rows of the class `KNOWN` say what is
known beforehand of a value, and how well. Outliers count less and less the
farther they are off (Huber 1964, by iteratively reweighted least squares). The covariance is that of the weighted
normal equations at the scatter found; it assumes errors of different rows to be independent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from qrobot.arrays import Bools, Floats, Ints
from qrobot.errors import IdentificationError

KNOWN: Final = -1  # class of rows whose deviation is all in `doubt`
NORMAL_95: Final = 1.959964  # half width of a 95 % interval, standard deviations
HUBER: Final = 1.345  # deviations beyond which a row counts less: 95 % efficient on normal errors (Huber 1981)
OUTLIER: Final = 4.0  # deviations beyond which a row is named
_MAD: Final = 1.4826  # median absolute deviation to standard deviation, of normal errors
_PASSES: Final = 50
_SETTLED: Final = 0.01  # of its standard deviation: smaller steps of a value are none
_SINGULAR: Final = 1e-6  # smallest over largest singular value of the columns, each scaled to length 1


@dataclass(frozen=True, eq=False)
class Fit:
    """A linear fit.

    Attributes:
        values: shape (p,).
        covariance: shape (p, p).
        scatter: standard deviation of a row of each class. Shape (classes,).
        residual: measured less fitted. Shape (rows,).
        weight: share in which each row counts, 1 for those that are no outliers. Shape (rows,).
        condition: of the columns, each scaled to length 1.
    """

    values: Floats
    covariance: Floats
    scatter: Floats
    residual: Floats
    weight: Floats
    condition: float

    @property
    def half_width(self) -> Floats:
        """Half width of the 95 % interval of each value. Shape (p,)."""
        return np.asarray(NORMAL_95 * np.sqrt(np.diag(self.covariance)))

    @property
    def outliers(self) -> Ints:
        """Rows that are more than `OUTLIER` deviations off."""
        return np.flatnonzero(self.weight < HUBER / OUTLIER)


def fit_linear(A: Floats, b: Floats, row_class: Ints, names: Sequence[str], doubt: Floats | None = None) -> Fit:
    """x of A x = b, by robust least squares.

    Args:
        A: shape (rows, p).
        b: shape (rows,).
        row_class: class of each row, from 0, or `KNOWN`. Shape (rows,).
        names: of the columns, for complaints.
        doubt: standard deviation of each row that is known beforehand and adds to its class's. Shape (rows,).

    Raises:
        IdentificationError: the rows do not determine every value; names those that they do not.
    """
    condition = _need_full_rank(A, names)
    known = np.zeros(len(b)) if doubt is None else doubt
    weight, scatter = np.ones(len(b)), np.full(int(row_class.max()) + 2, max(float(np.abs(b).max()), 1e-9))
    scatter[KNOWN] = 0.0
    certain = {int(c): _certain_half(row_class == c, known) for c in np.unique(row_class[row_class != KNOWN])}
    x, residual, lengths = np.zeros(len(names)), b, np.linalg.norm(A, axis=0)
    scaled = A / lengths
    for _ in range(_PASSES):
        step, deviation = _step(scaled, residual, weight / _variance(scatter, known, row_class))
        step, deviation = step / lengths, deviation / lengths
        x, residual = x + step, residual - A @ step
        scatter = _spread(residual, scatter, known, row_class, certain)
        off = np.abs(residual) / _deviation(scatter, known, row_class)
        weight = np.where(row_class == KNOWN, 1.0, np.minimum(1.0, HUBER / np.maximum(off, 1e-12)))
        if (np.abs(step) <= _SETTLED * deviation).all():
            break
    scatter = _judged(A, residual, weight, row_class, scatter, known, certain)
    information = np.sqrt(weight / _variance(scatter, known, row_class))[:, None] * A
    covariance: Floats = np.linalg.inv(information.T @ information).astype(np.float64)
    return Fit(x, covariance, scatter[:KNOWN], residual, weight, condition)


def _variance(scatter: Floats, known: Floats, row_class: Ints) -> Floats:
    """Variance of each row: its class's and its own known one; the last class is `KNOWN` and has none of its own."""
    return np.asarray(scatter[row_class] ** 2 + known**2)


def _deviation(scatter: Floats, known: Floats, row_class: Ints) -> Floats:
    return np.sqrt(_variance(scatter, known, row_class))


def _step(scaled: Floats, residual: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Step of the values by the weighted normal equations, and their standard deviations.

    Columns have length 1. Steps that follow take back what rounding did.
    """
    weighted = scaled * weight[:, None]
    gram = scaled.T @ weighted
    step = np.linalg.solve(gram, weighted.T @ residual)
    return np.asarray(step, np.float64), np.sqrt(np.diag(np.linalg.inv(gram)))


def _spread(residual: Floats, scatter: Floats, known: Floats, row_class: Ints, certain: dict[int, Bools]) -> Floats:
    """Standard deviation of each class with which its `certain` rows, in their own deviations, spread by 1; never 0."""
    floor = 1e-9 * max(float(np.abs(residual).max()), 1e-9)
    in_deviations = np.abs(residual) / _deviation(scatter, known, row_class)
    found = scatter.copy()
    for c, mine in certain.items():
        found[c] = max(scatter[c] * _MAD * float(np.median(in_deviations[mine])), floor)
    return found


def _certain_half(mine: Bools, known: Floats) -> Bools:
    """The half of the rows of a class with less doubt, and all as good: the others say little of its scatter."""
    return np.asarray(mine & (known <= np.median(known[mine])))


def _judged(
    A: Floats,
    residual: Floats,
    weight: Floats,
    row_class: Ints,
    scatter: Floats,
    known: Floats,
    certain: dict[int, Bools],
) -> Floats:
    """Standard deviation of each class, with the parameters it determines taken off its degrees of freedom."""
    variance = _variance(scatter, known, row_class)
    whitened = np.sqrt(weight / variance)[:, None] * A
    leverage = (whitened @ np.linalg.inv(whitened.T @ whitened) * whitened).sum(axis=1)
    judged = scatter.copy()
    for c, mine in certain.items():
        freedom = float(weight[mine].sum() - leverage[mine].sum())
        if freedom > 1.0:
            judged[c] *= max(1e-3, np.sqrt((weight * residual**2 / variance)[mine].sum() / freedom))
    return judged


def _need_full_rank(A: Floats, names: Sequence[str]) -> float:
    """Condition of the scaled columns. Raises IdentificationError when some cannot be told apart."""
    if len(A) < len(names):
        raise IdentificationError(f"{len(A)} observations for {len(names)} parameters: record more poses and sweeps")
    lengths = np.linalg.norm(A, axis=0)
    if not lengths.all():
        missing = ", ".join(name for name, length in zip(names, lengths, strict=True) if not length)
        raise IdentificationError(f"nothing recorded moves {missing}: record poses and sweeps of those joints")
    scaled = A / lengths
    squares, directions = np.linalg.eigh(scaled.T @ scaled)
    if squares[0] < _SINGULAR**2 * squares[-1]:
        mixed = ", ".join(names[i] for i in np.flatnonzero(np.abs(directions[:, 0]) > 0.1).tolist())
        raise IdentificationError(f"what was recorded cannot tell {mixed} apart: record more poses")
    return float(np.sqrt(squares[-1] / squares[0]))
