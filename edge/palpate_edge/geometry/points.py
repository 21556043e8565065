"""Distances between points."""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array, Mask


def distances(a: Array, b: Array) -> Array:
    """Return the distances (n, m) between points (n, 2) and (m, 2), or in space."""
    return np.asarray(np.sqrt(((a[:, None, :] - b[None, :, :]) ** 2).sum(axis=2)))


def spacing(points: Array) -> Array:
    """Return the distance (n,) from each of the points (n, 2), or (n, 3), to the nearest other one."""
    distance = distances(points, points)
    np.fill_diagonal(distance, np.inf)
    return np.asarray(distance.min(axis=1))


def repeated(points: Array, limit: float) -> Mask:
    """Return which of the points (n, 2) lie nearer than `limit` to an earlier one that is kept."""
    apart = distances(points, points)
    repeats = np.zeros(len(points), dtype=np.bool_)
    for index in range(1, len(points)):
        repeats[index] = (apart[index, :index][~repeats[:index]] < limit).any()
    return repeats
