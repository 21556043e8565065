"""The Gaussian kernel of the kernel expansions."""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array


def gaussian_kernel(a: Array, b: Array, length: float) -> Array:
    """Return the kernel matrix (n, m) of points (n, p) and (m, p); length: standard deviation."""
    squared = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1)[None] - 2 * a @ b.T
    return np.asarray(np.exp(-np.maximum(0.0, squared) / (2 * length**2)))


def gradient_product(points: Array, weights: Array) -> Array:
    """Return the mean outer product (p, p) of the gradients, at points (n, p), of all targets.

    weights (n, k): of the targets' kernel sums about the points themselves, length 1.
    """
    gram = gaussian_kernel(points, points, 1.0)
    total = np.zeros((points.shape[1],) * 2)
    for column in weights.T:
        pull = gram * column
        gradient = pull @ points - pull.sum(axis=1)[:, None] * points
        total += gradient.T @ gradient
    return np.asarray(total / len(points), dtype=np.float64)
