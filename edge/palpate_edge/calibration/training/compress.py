"""Fewer centres for a fitted kernel expansion: what a board must compute for every frame.

Neighbouring centres of a smooth kernel are nearly redundant. The f-greedy choice takes, each time, the point
where the expansion of the centres so far misses the whole one by most; the weights are fitted again to what
the whole expansion gives at all of its centres. (Wirtz and Haasdonk, A Vectorial Kernel Orthogonal Greedy
Algorithm, 2013, section 3; Mueller and Schaback, A Newton basis for Kernel Spaces, 2009, for the factor.)
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
    points: Array,
    values: Array,
    kernel: Kernel,
    count: int,
    importance: Array,
    units: Array | float = 1.0,
) -> tuple[Array, Array]:
    """Centres (m, p), m <= count of the `points` (n, p), and weights (m, k) whose kernel sum comes nearest to
    `values` (n, k) at all points, each by its importance (n,).

    units (k,): misses of unlike values are compared in these where centres are chosen.
    """
    pivots, factor = greedy_pivots(points, values / units, kernel, count)
    weighted = factor * importance[:, None]
    normal = weighted.T @ weighted + JITTER * np.eye(len(pivots))
    hidden = np.linalg.solve(normal, weighted.T @ (values * importance[:, None]))
    return points[pivots], np.linalg.solve(factor[pivots].T, hidden)


def greedy_pivots(points: Array, values: Array, kernel: Kernel, count: int) -> tuple[NDArray[np.intp], Array]:
    """Indices (m,) of the pivots and factor (n, m): factor @ factor.T is the kernel matrix (n, n) but for
    what m <= count points cannot explain.

    Each pivot is the point whose values (n, k) the sum about those before it misses by most. The kernel of a
    point with itself is 1.
    """
    left, missed = np.ones(len(points)), values.copy()
    rows = np.zeros((min(count, len(points)), len(points)))  # of the factor's transpose: each in one piece
    pivots: list[int] = []
    for number in range(len(rows)):
        miss = np.where(left > UNTOLD, np.linalg.norm(missed, axis=1), 0.0)
        pivot = int(np.argmax(miss))
        if not miss[pivot]:
            break
        pivots.append(pivot)
        column = kernel(points, points[pivot : pivot + 1])[:, 0]
        column -= rows[:number, pivot] @ rows[:number]
        rows[number] = column / np.sqrt(left[pivot])
        missed -= np.outer(rows[number], missed[pivot] / rows[number, pivot])
        left = np.maximum(left - rows[number] ** 2, 0.0)
    return np.array(pivots, dtype=np.intp), rows[: len(pivots)].T
