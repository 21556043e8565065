"""The grasped object: a convex prism, perhaps with tapered ends; its faces, inertia and contact geometry."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
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
    """A prism.

    corners_m: (n, 2), counter-clockwise, about the centroid. sections: heights over the centre of mass, from
    the lowest, with the outline there over corners_m. faces: the side faces. inertia_kgm2: (3,) about x, y,
    z.
    """

    corners_m: Array
    sections: tuple[tuple[float, float], ...]
    mass_kg: float
    inertia_kgm2: Array
    faces: tuple[Face, ...]

    @property
    def vertices_m(self) -> Array:
        """(sections n, 3): the corners of each section, from the lowest."""
        corners = self.corners_m
        return np.vstack(
            [
                np.hstack((ratio * corners, np.full((len(corners), 1), height)))
                for height, ratio in self.sections
            ]
        )

    def all_faces_m(self) -> list[Array]:
        """Return the corners (k, 3) of every face, those of the ends too, counter-clockwise from outside."""
        rings = self.vertices_m.reshape(len(self.sections), -1, 3)
        faces = [rings[0][::-1], rings[-1]]
        for low, high in itertools.pairwise(rings):
            around = zip(low, np.roll(low, -1, axis=0), np.roll(high, -1, axis=0), high, strict=True)
            faces += [np.array(corners) for corners in around]
        return faces

    @property
    def side_half_m(self) -> float:
        """Half the height of the side faces."""
        return max(height for height, ratio in self.sections if ratio == 1.0)


def prism_of(config: ObjectConfig) -> Prism:
    """Return the prism described in hand.toml.

    Raises ConfigError if the outline is not convex and counter-clockwise, if the tapers leave no side face,
    or if the inertia is impossible for a rigid body.
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
    half_m, side_m = 0.5 * config.length_m, 0.5 * config.length_m - config.taper_m
    if side_m <= 0.0:
        raise ConfigError(
            f"twin.object.taper_m = {config.taper_m:g} leaves no side face: give less than half of length_m"
        )
    sections: tuple[tuple[float, float], ...] = ((-side_m, 1.0), (side_m, 1.0))
    if config.taper_m > 0.0:
        sections = ((-half_m, config.end_ratio), *sections, (half_m, config.end_ratio))
    inertia = config.inertia_kgm2
    if inertia is None:
        inertia = _uniform_inertia(config.mass_kg, sections, area_m2, second)
    if 2.0 * max(inertia) > sum(inertia) * (1.0 + 1e-9):
        raise ConfigError(
            "twin.object.inertia_kgm2 violates the triangle inequality, so no rigid body can have it:"
            " correct it, or leave it out for a uniform prism"
        )
    return Prism(corners, sections, config.mass_kg, np.array(inertia), tuple(map(_face, corners, edges)))


def _uniform_inertia(
    mass_kg: float, sections: Sequence[tuple[float, float]], area_m2: float, second: Array
) -> tuple[float, float, float]:
    """Return the inertia about x, y, z of a uniform body.

    area_m2, second (2,): area, and integrals of x^2 and y^2, of the outline. Between two sections the
    outline's ratio is linear in height, so the integrands are polynomials of degree 4, which three points
    integrate exactly (Gauss-Legendre).
    """
    volume, xx, yy, zz = 0.0, 0.0, 0.0, 0.0
    points, weights = np.polynomial.legendre.leggauss(3)
    for (low, first), (high, last) in itertools.pairwise(sections):
        share = 0.5 * (points + 1.0)
        height, ratio = low + share * (high - low), first + share * (last - first)
        per = 0.5 * (high - low) * weights
        volume += float(per @ (area_m2 * ratio**2))
        xx += float(per @ (second[0] * ratio**4))
        yy += float(per @ (second[1] * ratio**4))
        zz += float(per @ (area_m2 * ratio**2 * height**2))
    density = mass_kg / volume
    return density * (yy + zz), density * (xx + zz), density * (xx + yy)


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
    return face.span_m[0] <= along <= face.span_m[1] and abs(float(point_m[2])) <= prism.side_half_m
