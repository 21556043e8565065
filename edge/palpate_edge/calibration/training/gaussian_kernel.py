"""The Gaussian kernel of the kernel expansions."""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array


def gaussian_kernel(a: Array, b: Array, length: float) -> Array:
    """Return the kernel matrix (n, m) of points (n, p) and (m, p); length: standard deviation."""
    squared = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1)[None] - 2 * a @ b.T
    return np.asarray(np.exp(-np.maximum(0.0, squared) / (2 * length**2)))
