"""Integration points of the dome's outer surface, where contact forces act."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from palpate_edge.common.arrays import Array
from palpate_twin.dome.mesh import DomeMesh

POINTS_AN_EDGE = 4  # Gauss points; more than the element's order needs, as contact ends inside elements


@dataclass(frozen=True, slots=True)
class Surface:
    """Integration points of a surface.

    to_points: (3 q, 3 n) maps nodal values to the q integration points; points_mm: (q, 3), undeformed;
    area_mm2: (q,) share of each point in the undeformed surface.
    """

    to_points: sparse.csr_matrix
    points_mm: Array
    area_mm2: Array


def outer_surface(mesh: DomeMesh) -> Surface:
    """Return the Gauss points of the outer surface's 8-node quadrilaterals."""
    along, weight = np.polynomial.legendre.leggauss(POINTS_AN_EDGE)
    r, s = (axis.ravel() for axis in np.meshgrid(along, along, indexing="ij"))
    weights = np.outer(weight, weight).ravel()
    shape, by_r, by_s = serendipity(r, s)
    corners = mesh.points_mm[mesh.outer_faces]
    points = np.einsum("qa,fai->fqi", shape, corners)
    normal = np.cross(np.einsum("qa,fai->fqi", by_r, corners), np.einsum("qa,fai->fqi", by_s, corners))
    area = np.linalg.norm(normal, axis=2) * weights
    faces, count = len(corners), len(weights)
    row = np.repeat(np.arange(faces * count), 8)
    column = np.broadcast_to(mesh.outer_faces[:, None, :], (faces, count, 8)).ravel()
    value = np.broadcast_to(shape, (faces, count, 8)).ravel()
    scalar = sparse.csr_matrix((value, (row, column)), shape=(faces * count, len(mesh.points_mm)))
    return Surface(sparse.kron(scalar, sparse.eye(3), format="csr"), points.reshape(-1, 3), area.ravel())


def serendipity(r: Array, s: Array) -> tuple[Array, Array, Array]:
    """Return the 8-node quadrilateral's shape functions and their derivatives by r and s, each (q, 8)."""
    shape, by_r, by_s = [], [], []
    for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        shape.append((1 + a * r) * (1 + b * s) * (a * r + b * s - 1) / 4)
        by_r.append(a * (1 + b * s) * (2 * a * r + b * s) / 4)
        by_s.append(b * (1 + a * r) * (a * r + 2 * b * s) / 4)
    for a, b in ((0, -1), (1, 0), (0, 1), (-1, 0)):
        shape.append((1 - r * r) * (1 + b * s) / 2 if a == 0 else (1 + a * r) * (1 - s * s) / 2)
        by_r.append(-r * (1 + b * s) if a == 0 else a * (1 - s * s) / 2)
        by_s.append(b * (1 - r * r) / 2 if a == 0 else -s * (1 + a * r))
    return np.stack(shape, axis=1), np.stack(by_r, axis=1), np.stack(by_s, axis=1)
