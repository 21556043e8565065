"""The grasped object: a convex prism with its faces, inertia and contact geometry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import ConfigError
from palpate_host.common.rotation import cross
from palpate_host.config.twin_config import ObjectConfig


@dataclass(frozen=True, slots=True)
class Face:
    """A side face in the object's frame.

    normal: (3,) outward unit normal; distance_m: distance from the centre of mass; tangent: (3,) unit vector
    along the outline; span_m: interval of the face along the tangent.
    """

    normal: Array
    distance_m: float
    tangent: Array
    span_m: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Prism:
    """A prism. corners_m: (n, 2), counter-clockwise, about the centroid; inertia_kgm2: (3,) about x, y, z."""

    corners_m: Array
    length_m: float
    mass_kg: float
    inertia_kgm2: Array
    faces: tuple[Face, ...]

    @property
    def vertices_m(self) -> Array:
        """(2 n, 3): the corners at the lower end, then at the upper end."""
        ends = [np.full((len(self.corners_m), 1), sign * self.length_m / 2.0) for sign in (-1.0, 1.0)]
        return np.vstack([np.hstack((self.corners_m, end)) for end in ends])


def prism_of(config: ObjectConfig) -> Prism:
    """Return the prism described in hand.toml.

    Raises ConfigError if the outline is not convex and counter-clockwise, or if the inertia is impossible for
    a rigid body.
    """
    outline = np.array(config.outline_m)
    area_m2, centroid, second = _moments(outline)
    corners = outline - centroid
    edges = np.roll(corners, -1, axis=0) - corners
    turns = edges[:, 0] * np.roll(edges, -1, axis=0)[:, 1] - edges[:, 1] * np.roll(edges, -1, axis=0)[:, 0]
    if area_m2 <= 0.0 or np.any(turns <= 0.0):
        raise ConfigError(
            "twin.object.outline_m is not convex and counter-clockwise (seen from +z): reorder its corners"
        )
    inertia = config.inertia_kgm2
    if inertia is None:
        along = config.length_m**2 / 12.0
        xx, yy = config.mass_kg * second / area_m2
        inertia = (yy + config.mass_kg * along, xx + config.mass_kg * along, xx + yy)
    if 2.0 * max(inertia) > sum(inertia) * (1.0 + 1e-9):
        raise ConfigError(
            "twin.object.inertia_kgm2 violates the triangle inequality, so no rigid body can have it:"
            " correct it, or leave it out for a uniform prism"
        )
    return Prism(
        corners, config.length_m, config.mass_kg, np.array(inertia), tuple(map(_face, corners, edges))
    )


def _moments(outline: Array) -> tuple[float, Array, Array]:
    """Return area, centroid (2,), and the integrals of x^2 and y^2 about the centroid."""
    x, y = outline.T
    x2, y2 = np.roll(x, -1), np.roll(y, -1)
    pieces = x * y2 - x2 * y
    area = 0.5 * float(pieces.sum())
    centroid = np.array([((x + x2) * pieces).sum(), ((y + y2) * pieces).sum()]) / (6.0 * area)
    squares = [((a * a + a * b + b * b) * pieces).sum() / 12.0 for a, b in ((x, x2), (y, y2))]
    return area, centroid, np.array(squares) - area * centroid**2


def _face(corner: Array, edge: Array) -> Face:
    tangent = np.append(edge / np.linalg.norm(edge), 0.0)
    normal = cross(tangent, np.array([0.0, 0.0, 1.0]))
    start = float(corner @ tangent[:2])
    return Face(normal, float(corner @ normal[:2]), tangent, (start, start + float(np.linalg.norm(edge))))


def nearest_face(prism: Prism, centre_m: Array) -> int:
    """Return the index of the side face in front of which a point (3,), in the object's frame, lies."""
    gaps = [float(face.normal @ centre_m) - face.distance_m for face in prism.faces]
    return int(np.argmax(gaps))


def is_on_face(prism: Prism, face: Face, point_m: Array) -> bool:
    """Return whether a point (3,) of the face's plane, in the object's frame, lies within the face."""
    along = float(face.tangent @ point_m)
    return face.span_m[0] <= along <= face.span_m[1] and abs(float(point_m[2])) <= prism.length_m / 2.0
