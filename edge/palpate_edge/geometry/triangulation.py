"""Delaunay triangulation of points in the image."""

from __future__ import annotations

import cv2
import numpy as np

from palpate_edge.common.arrays import Array, Indices


def delaunay(points_px: Array) -> Indices:
    """Return the Delaunay triangles (m, 3) of points (n, 2), as indices."""
    low, high = points_px.min(axis=0) - 2, points_px.max(axis=0) + 2
    size = np.ceil(high - low).astype(int)
    plane = cv2.Subdiv2D((0, 0, int(size[0]), int(size[1])))
    local = (points_px - low).astype(np.float32)
    plane.insert(local)
    corners = np.asarray(plane.getTriangleList(), dtype=np.float64).reshape(-1, 2)
    distance = np.sqrt(((corners[:, None, :] - local[None, :, :]) ** 2).sum(axis=2))
    index = distance.argmin(axis=1).reshape(-1, 3)
    real = (distance.min(axis=1).reshape(-1, 3) < 1e-2).all(axis=1)  # Subdiv2D adds outer corners
    return np.asarray(index[real], dtype=np.intp)
