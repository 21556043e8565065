"""Fewer centres for a fitted kernel expansion: what a board must compute for every frame.

Neighbouring centres of a smooth kernel are nearly redundant. Pivoted Cholesky picks those that explain the
others best (each time the one least explained so far); the weights are fitted again to what the whole
expansion gives at all of its centres. (Fine and Scheinberg, Efficient SVM Training Using Low-Rank Kernel
Representations, 2001, section 4: the incomplete factorisation and its pivots.)
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.arrays import Array

Kernel = Callable[[Array, Array], Array]

JITTER = 1e-8  # of the normal equations
UNTOLD = 1e-10  # variance left at a centre that needs no pivot of its own


def compressed(
    points: Array, values: Array, kernel: Kernel, count: int, importance: Array
) -> tuple[Array, Array]:
    """Centres (m, p), m <= count of the `points` (n, p), and weights (m, k) whose kernel sum comes nearest to
    `values` (n, k) at all points; importance (n,) of each point."""
    pivots, factor = pivoted_cholesky(points, kernel, count)
    weighted = factor * importance[:, None]
    normal = weighted.T @ weighted + JITTER * np.eye(len(pivots))
    hidden = np.linalg.solve(normal, weighted.T @ (values * importance[:, None]))
    return points[pivots], np.linalg.solve(factor[pivots].T, hidden)


def pivoted_cholesky(points: Array, kernel: Kernel, count: int) -> tuple[NDArray[np.intp], Array]:
    """Indices (m,) of the pivots and factor (n, m): factor @ factor.T is the kernel matrix (n, n) but for
    what m <= count points cannot explain. The kernel of a point with itself is 1."""
    left = np.ones(len(points))
    rows = np.zeros((min(count, len(points)), len(points)))  # of the factor's transpose: each in one piece
    pivots: list[int] = []
    for number in range(len(rows)):
        pivot = int(np.argmax(left))
        if left[pivot] < UNTOLD:
            break
        pivots.append(pivot)
        column = kernel(points, points[pivot : pivot + 1])[:, 0]
        column -= rows[:number, pivot] @ rows[:number]
        rows[number] = column / np.sqrt(left[pivot])
        left = np.maximum(left - rows[number] ** 2, 0.0)
    return np.array(pivots, dtype=np.intp), rows[: len(pivots)].T
