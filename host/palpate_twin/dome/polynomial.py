"""Interpolation by polynomials through the nodes around a value."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.arrays import Array


def lagrange(nodes: Array, at: float, count: int) -> tuple[NDArray[np.intp], Array]:
    """Return indices of the `count` nodes around `at`, and the weights of their polynomial at `at`."""
    first = int(np.clip(np.searchsorted(nodes, at) - count // 2, 0, len(nodes) - count))
    near = nodes[first : first + count]
    others = ~np.eye(count, dtype=bool)
    ratio = (at - near)[None, :] / np.where(others, near[:, None] - near[None, :], 1.0)
    return np.arange(first, first + count), np.prod(ratio, axis=1, where=others)
