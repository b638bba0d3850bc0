"""The inverse of a small matrix against its definition."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.model.solve import invert_into


@pytest.mark.parametrize("m", [1, 2, 3, 6])
def test_a_matrix_times_its_inverse_is_the_identity_and_the_determinant_is_numpys(m: int) -> None:
    for seed in range(20):
        A = np.random.default_rng(seed).normal(size=(m, m))
        kept, out = A.copy(), np.empty((m, m))
        determinant = invert_into(A, np.empty((m, m)), out)
        assert determinant == pytest.approx(np.linalg.det(kept), rel=1e-9)
        np.testing.assert_allclose(kept @ out, np.eye(m), atol=1e-9)
        np.testing.assert_array_equal(A, kept)


def test_zeros_on_the_diagonal_are_passed_by_swapping_rows() -> None:
    A, out = np.array([[0.0, 2.0], [4.0, 0.0]]), np.empty((2, 2))
    assert invert_into(A, np.empty((2, 2)), out) == -8.0
    np.testing.assert_array_equal(out, [[0.0, 0.25], [0.5, 0.0]])


def test_a_singular_matrix_has_determinant_zero() -> None:
    A = np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 0.0], [4.0, 5.0, 6.0]])
    assert invert_into(A, np.empty((3, 3)), np.empty((3, 3))) == 0.0
