"""The inverse of a small matrix, where a call of a library costs more than the work."""

from __future__ import annotations

from qrobot.arrays import Floats
from qrobot.realtime.jit import lean_kernel


@lean_kernel
def invert_into(A: Floats, work: Floats, out: Floats) -> float:
    """`A @ out == identity` by Gauss and Jordan's elimination with partial pivoting. Shapes (m, m).

    Returns:
        The determinant of `A`; where that is 0, `out` is no inverse.
    """
    m, determinant = A.shape[0], 1.0
    for i in range(m):
        for j in range(m):
            work[i, j] = A[i, j]
            out[i, j] = 1.0 if i == j else 0.0
    for k in range(m):
        pivot = _pivot_row(work, k)
        if work[pivot, k] == 0.0:
            return 0.0
        if pivot != k:
            determinant = -determinant
            _swap_rows(work, pivot, k)
            _swap_rows(out, pivot, k)
        determinant *= work[k, k]
        _eliminate(work, out, k)
    return determinant


@lean_kernel
def _pivot_row(work: Floats, k: int) -> int:
    """The row from k on with the largest entry in column k."""
    best = k
    for i in range(k + 1, work.shape[0]):
        if abs(work[i, k]) > abs(work[best, k]):
            best = i
    return best


@lean_kernel
def _swap_rows(matrix: Floats, i: int, k: int) -> None:
    for j in range(matrix.shape[1]):
        matrix[i, j], matrix[k, j] = matrix[k, j], matrix[i, j]


@lean_kernel
def _eliminate(work: Floats, out: Floats, k: int) -> None:
    """Make column k of `work` that of the identity, and do the same to `out`."""
    m, per_pivot = work.shape[0], 1.0 / work[k, k]
    for j in range(m):
        work[k, j] *= per_pivot
        out[k, j] *= per_pivot
    for i in range(m):
        share = work[i, k]
        if i != k and share != 0.0:
            for j in range(m):
                work[i, j] -= share * work[k, j]
                out[i, j] -= share * out[k, j]
