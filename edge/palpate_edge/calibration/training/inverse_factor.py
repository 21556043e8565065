"""The inverse of a kernel matrix as a product, at a quarter of the cost of the inverse itself."""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array

SMALL = 64  # rows of a triangle that is inverted in one piece


def inverse_factor(matrix: Array) -> Array:
    """Return the lower triangle F (n, n) with F.T @ F = the inverse of a symmetric positive definite matrix.

    Raises numpy.linalg.LinAlgError for a matrix that is not positive definite.
    """
    return _inverse_of_triangle(np.asarray(np.linalg.cholesky(matrix), dtype=np.float64))


def _inverse_of_triangle(lower: Array) -> Array:
    """Return the inverse of a lower triangle, by halves: products of blocks are fast, rows are not."""
    count = len(lower)
    if count <= SMALL:
        return np.asarray(np.linalg.inv(lower), dtype=np.float64)
    half = count // 2
    inverse = np.zeros_like(lower)
    inverse[:half, :half] = _inverse_of_triangle(lower[:half, :half])
    inverse[half:, half:] = _inverse_of_triangle(lower[half:, half:])
    inverse[half:, :half] = -inverse[half:, half:] @ (lower[half:, :half] @ inverse[:half, :half])
    return inverse
