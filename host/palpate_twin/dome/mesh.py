"""Mesh of a hollow hemisphere of 20-node hexahedra: the cap and four half sides of a cubed sphere.

It has no singular point at the pole. Coordinates are in the fingertip frame F (z from base to apex), in mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array, Indices
from palpate_edge.common.errors import ConfigError

CAP_HALF_ANGLE_RAD = np.radians(35.0)  # polar angle at the middle of the cap's edge

# A hexahedron's 20 nodes on its 3x3x3 lattice: corners, then mid-edge nodes (VTK's order).
HEXAHEDRON20 = np.array(
    [
        *[(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)],
        *[(1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2)],
        *[(0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)],
    ]
)
OUTER_FACE = (4, 5, 6, 7, 12, 13, 14, 15)
"""Nodes of the 20 whose third lattice index is 2: corners, then mid-edge nodes."""


@dataclass(frozen=True, slots=True)
class Resolution:
    """Number of elements along an edge of the cap, from the cap down to the base, and through the wall."""

    cap: int = 8
    side: int = 6
    wall: int = 2


@dataclass(frozen=True, slots=True)
class DomeMesh:
    """A mesh.

    points_mm (n, 3); cells (m, 20); outer_faces (f, 8): nodes of the outer surface's quadrilaterals; base:
    nodes of the base plane z = 0; mirror: nodes of the plane y = 0 (empty unless `half`).
    """

    points_mm: Array
    cells: Indices
    outer_faces: Indices
    base: Indices
    mirror: Indices
    outer_radius_mm: float
    wall_mm: float

    @property
    def half(self) -> bool:
        """True if only y >= 0 is meshed."""
        return self.mirror.size > 0


def dome_mesh(
    outer_radius_mm: float = 30.0,
    wall_mm: float = 5.0,
    resolution: Resolution | None = None,
    half: bool = False,
) -> DomeMesh:
    """Mesh the dome, or its half y >= 0. Raises ConfigError for an impossible size or resolution."""
    resolution = resolution or Resolution()
    if not 0 < wall_mm < outer_radius_mm:
        raise ConfigError(
            f"wall_mm = {wall_mm:g} is not between 0 and the outer radius of {outer_radius_mm:g} mm"
        )
    if min(resolution.cap, resolution.side, resolution.wall) < 1:
        raise ConfigError(f"{resolution}: all numbers of elements must be at least 1")
    if half and resolution.cap % 2:
        raise ConfigError(f"{resolution}: cap must be even, because a half dome is cut through the cap")
    fractions = np.linspace(0, 1, 2 * resolution.wall + 1)
    radii_mm = outer_radius_mm - wall_mm * (1 - fractions)
    grids = [_cap(resolution.cap), *_sides(resolution.cap, resolution.side)]
    points: list[Array] = []
    cells: list[Indices] = []
    for directions in grids:
        lattice = directions[:, :, None, :] * radii_mm[:, None]
        cells.append(_hexahedra(lattice.shape[:3]) + sum(len(block) for block in points))
        points.append(lattice.reshape(-1, 3))
    mesh_points, mesh_cells = _without_duplicates(np.concatenate(points), np.concatenate(cells))
    if half:
        inside = mesh_points[mesh_cells].mean(axis=1)[:, 1] > 0
        mesh_points, mesh_cells = _only(mesh_points, mesh_cells[inside])
    return _named_sets(mesh_points, mesh_cells, outer_radius_mm, wall_mm, half)


def _cap(count: int) -> Array:
    """Return unit vectors on the lattice (2 count + 1, 2 count + 1, 3) of the cap around the pole."""
    along = np.tan(CAP_HALF_ANGLE_RAD * np.linspace(-1, 1, 2 * count + 1))
    x, y = np.meshgrid(along, along, indexing="ij")
    return _unit(np.stack([x, y, np.ones_like(x)], axis=2))


def _sides(cap: int, side: int) -> list[Array]:
    """Return the four blocks between the cap's edges and the base, the first towards +x.

    Axes: downwards, around z. Polar angle and azimuth change linearly from the cap's edge to an even spacing
    at the base.
    """
    across = np.linspace(-1, 1, 2 * cap + 1)
    down = np.linspace(0, 1, 2 * side + 1)[:, None]
    edge_y = np.tan(CAP_HALF_ANGLE_RAD * across) / np.tan(CAP_HALF_ANGLE_RAD)
    edge_phi = np.arctan(edge_y)
    edge_theta = np.arctan(np.tan(CAP_HALF_ANGLE_RAD) * np.hypot(1, edge_y))
    theta = edge_theta + (np.pi / 2 - edge_theta) * down
    phi = edge_phi + (across * np.pi / 4 - edge_phi) * down
    return [
        np.stack(
            [
                np.sin(theta) * np.cos(phi + quarter),
                np.sin(theta) * np.sin(phi + quarter),
                np.cos(theta) * np.ones_like(phi),
            ],
            axis=2,
        )
        for quarter in np.arange(4) * np.pi / 2
    ]


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def _hexahedra(shape: tuple[int, ...]) -> Indices:
    """Return the nodes (m, 20) of the hexahedra on a lattice in which every second node is a corner."""
    number = np.arange(int(np.prod(shape))).reshape(shape)
    starts = np.stack(np.meshgrid(*[np.arange(0, n - 1, 2) for n in shape], indexing="ij"), axis=-1)
    nodes = starts.reshape(-1, 1, 3) + HEXAHEDRON20
    return np.asarray(number[nodes[..., 0], nodes[..., 1], nodes[..., 2]])


def _without_duplicates(points: Array, cells: Indices) -> tuple[Array, Indices]:
    """Merge the nodes shared by neighbouring blocks and remove unused lattice points."""
    _, first, merged = np.unique(np.round(points, 6) + 0.0, axis=0, return_index=True, return_inverse=True)
    return _only(points[first], merged.reshape(-1)[cells])


def _only(points: Array, cells: Indices) -> tuple[Array, Indices]:
    used, renumbered = np.unique(cells, return_inverse=True)
    return points[used], renumbered.reshape(cells.shape)


def _named_sets(points: Array, cells: Indices, outer_mm: float, wall_mm: float, half: bool) -> DomeMesh:
    faces = cells[:, OUTER_FACE]
    outside = (np.linalg.norm(points, axis=1) > outer_mm * (1 - 1e-9))[faces].all(axis=1)
    base = np.flatnonzero(np.abs(points[:, 2]) < 1e-6)
    mirror = np.flatnonzero(np.abs(points[:, 1]) < 1e-6) if half else np.zeros(0, dtype=np.intp)
    return DomeMesh(points, cells, faces[outside], base, mirror, outer_mm, wall_mm)
