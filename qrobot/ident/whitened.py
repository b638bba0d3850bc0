"""Residuals of a fit in units of their deviations, and the part of further columns that the fit does not explain."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from qrobot.arrays import Floats


class WhitenedFit(NamedTuple):
    """A fit whose rows have unit deviation.

    Attributes:
        residual: shape (m,).
        fitted: orthonormal columns of the fit. Shape (m, p).
        inverse: of the deviation of each observation. Shape (m,).
    """

    residual: Floats
    fitted: Floats
    inverse: Floats

    def with_columns(self, columns: Floats) -> WhitenedFit:
        """The same fit with further orthonormal columns beside the fitted ones."""
        residual = self.residual - columns @ (columns.T @ self.residual)
        return WhitenedFit(residual, np.column_stack([self.fitted, columns]), self.inverse)


def unexplained(fitted: Floats, columns: Floats) -> Floats:
    """Part of columns (m, ...) that the orthonormal columns `fitted` (m, p) do not explain."""
    return np.asarray(columns - fitted @ (fitted.T @ columns))
