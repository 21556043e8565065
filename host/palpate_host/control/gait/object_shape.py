"""The faces of a convex object on which fingers take hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common.rotation import cross


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


def shape_of(faces: list[Array]) -> ObjectShape:
    """Return the object with these faces; each has corners (k, 3), counter-clockwise from outside."""
    return ObjectShape(tuple(ShapeFace(_normal(corners), corners) for corners in faces))


def _normal(corners_m: Array) -> Array:
    """Return the unit normal (3,) of a polygon, by Newell's sum over its edges."""
    total = np.cross(corners_m, np.roll(corners_m, -1, axis=0)).sum(axis=0)
    return np.asarray(total / np.linalg.norm(total))
