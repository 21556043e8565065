"""Interpolate the displacement at points inside the wall with the elements' shape functions."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import ConfigError
from palpate_twin.dome import hexahedron
from palpate_twin.dome.mesh import DomeMesh

NEAREST_CELLS = 12
INVERSE_STEPS = 12
OUTSIDE = 1.02  # natural coordinate: the elements' faces deviate from the sphere by a few micrometres


class Sampler:
    """Points in the undeformed dome; on a half dome, points of y < 0 get the mirror image's displacement."""

    def __init__(self, mesh: DomeMesh, points_mm: Array) -> None:
        """Find the element of each of points_mm (q, 3). Raises ConfigError for a point outside the wall."""
        flip = mesh.half & (points_mm[:, 1] < 0)
        self._sign = np.where(flip[:, None], [1.0, -1.0, 1.0], 1.0)
        self._weights = _shape_weights(mesh, points_mm * self._sign)

    def __call__(self, displacement_mm: Array) -> Array:
        """Return the displacement (q, 3) of the points from that of the nodes (n, 3), in mm and F."""
        return np.asarray((self._weights @ displacement_mm) * self._sign)


def _shape_weights(mesh: DomeMesh, points_mm: Array) -> sparse.csr_matrix:
    """Return each point's shape functions (q, n) in its element, found by inverting the element's map."""
    corners = mesh.points_mm[mesh.cells]
    tree = cKDTree(corners.mean(axis=1))
    _, nearest = tree.query(points_mm, k=min(NEAREST_CELLS, len(corners)))
    nearest = nearest.reshape(len(points_mm), -1)
    best = np.full(len(points_mm), np.inf)
    cell = np.zeros(len(points_mm), dtype=np.intp)
    natural = np.zeros_like(points_mm)
    for candidate in nearest.T:
        found = _natural_coordinates(corners[candidate], points_mm)
        outside = np.abs(found).max(axis=1)
        better = outside < best - 1e-9
        best, cell = np.where(better, outside, best), np.where(better, candidate, cell)
        natural[better] = found[better]
    if best.max() > OUTSIDE:
        x, y, z = points_mm[best.argmax()]
        raise ConfigError(
            f"point {x:.2f}, {y:.2f}, {z:.2f} mm is outside of the dome's wall: give points inside"
        )
    shape = hexahedron.shape(natural)
    rows = np.repeat(np.arange(len(points_mm)), shape.shape[1])
    size = (len(points_mm), len(mesh.points_mm))
    return sparse.csr_matrix((shape.ravel(), (rows, mesh.cells[cell].ravel())), shape=size)


def _natural_coordinates(corners: Array, points_mm: Array) -> Array:
    """Return the natural coordinates (q, 3) of each point in its element (q, 20, 3), by Newton's method."""
    natural = np.zeros_like(points_mm)
    for _ in range(INVERSE_STEPS):
        miss = points_mm - np.einsum("qa,qai->qi", hexahedron.shape(natural), corners)
        jacobian = np.einsum("qaj,qai->qij", hexahedron.slope(natural), corners)
        natural = np.clip(natural + np.linalg.solve(jacobian, miss[:, :, None])[:, :, 0], -2, 2)
    return natural
