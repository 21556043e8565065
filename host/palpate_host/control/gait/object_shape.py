"""The faces of a convex object on which fingers take hold."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common.rotation import cross

FLAT_M = 1e-4
FEWEST_FACES = 4


@dataclass(frozen=True, slots=True)
class ShapeFace:
    """A flat face. normal: (3,) outward unit normal; corners_m: (k, 3), counter-clockwise from outside."""

    normal: Array
    corners_m: Array

    @property
    def distance_m(self) -> float:
        """The distance of the face's plane from the origin."""
        return float(self.normal @ self.corners_m[0])

    def inset_m(self, point_m: Array) -> float:
        """Return how far a point (3,) of the plane is inside the nearest edge; negative beside the face."""
        insets = []
        for corner, following in zip(self.corners_m, np.roll(self.corners_m, -1, axis=0), strict=True):
            edge = following - corner
            inward = cross(self.normal, edge / np.linalg.norm(edge))
            insets.append(float(inward @ (point_m - corner)))
        return min(insets)


@dataclass(frozen=True, slots=True)
class ObjectShape:
    """A convex object in a frame of its own."""

    faces: tuple[ShapeFace, ...]

    def moved(self, R: Array, shift_m: Array) -> ObjectShape:
        """Return the object turned by R (3, 3), then moved by (3,)."""
        return ObjectShape(
            tuple(ShapeFace(R @ face.normal, face.corners_m @ R.T + shift_m) for face in self.faces)
        )

    def nearest_face(self, point_m: Array) -> ShapeFace:
        """Return the face in front of which a point (3,) lies."""
        return max(self.faces, key=lambda face: float(face.normal @ point_m) - face.distance_m)

    def gap_m(self, points_m: Array) -> Array:
        """Return how far points (k, 3) are from the object at least; negative inside.

        The distance from the farthest plane: exact in front of a face, less than the distance beside an edge.
        """
        normals = np.array([face.normal for face in self.faces])
        distances = np.array([face.distance_m for face in self.faces])
        return np.asarray((points_m @ normals.T - distances).max(axis=1))


def hull_of(corners_m: Array) -> tuple[ObjectShape, Array]:
    """Return the convex hull of corners (k, 3), and the centre (3,) of its volume.

    Corners within `FLAT_M` of a plane are of one face. Raises ValueError when the corners enclose no volume.
    """
    triples = np.array(list(itertools.combinations(range(len(corners_m)), 3)))
    first, second, third = (corners_m[triples[:, k]] for k in range(3))
    normals = np.cross(second - first, third - first)
    lengths = np.linalg.norm(normals, axis=1)
    is_plane = lengths > FLAT_M * FLAT_M
    normals = normals[is_plane] / lengths[is_plane, None]
    heights_m = normals @ corners_m.T - np.vecdot(normals, first[is_plane])[:, None]
    faces: dict[frozenset[int], Array] = {}
    for side in (1.0, -1.0):
        outside = side * heights_m > FLAT_M
        for index in np.flatnonzero(~outside.any(axis=1)):
            members = np.flatnonzero(np.abs(heights_m[index]) <= FLAT_M)
            faces.setdefault(frozenset(members.tolist()), side * normals[index])
    largest = [one for one in faces if not any(one < other for other in faces)]
    if len(largest) < FEWEST_FACES:
        raise ValueError("the corners enclose no volume")
    polygons = [_around(corners_m[sorted(one)], faces[one]) for one in largest]
    return shape_of(polygons), _centre_of(polygons)


def _around(corners_m: Array, normal: Array) -> Array:
    """Return the corners (k, 3) of a convex polygon counter-clockwise about its normal."""
    from_middle_m = corners_m - corners_m.mean(axis=0)
    along = from_middle_m[0]
    angles = np.arctan2(from_middle_m @ cross(normal, along), from_middle_m @ along)
    return np.asarray(corners_m[np.argsort(angles)])


def _centre_of(polygons: list[Array]) -> Array:
    """Return the centre (3,) of the volume inside polygons, by tetrahedra from one point."""
    inside_m = np.concatenate(polygons).mean(axis=0)
    total, moment_m = 0.0, np.zeros(3)
    for polygon in polygons:
        a, *rest = polygon - inside_m
        for b, c in itertools.pairwise(rest):
            volume = float(a @ cross(b, c))
            total += volume
            moment_m = moment_m + volume * (a + b + c) / 4.0
    return np.asarray(inside_m + moment_m / total)


def shape_of(faces: list[Array]) -> ObjectShape:
    """Return the object with these faces; each has corners (k, 3), counter-clockwise from outside."""
    return ObjectShape(tuple(ShapeFace(_normal(corners), corners) for corners in faces))


def _normal(corners_m: Array) -> Array:
    """Return the unit normal (3,) of a polygon, by Newell's sum over its edges."""
    total = np.cross(corners_m, np.roll(corners_m, -1, axis=0)).sum(axis=0)
    return np.asarray(total / np.linalg.norm(total))
