"""Virtual points: rings of beads -> ellipses -> points (Eq. 1) -> triangles -> area change (Figs. 4-7).

Choices where the paper leaves a question open:

- Eq. (1b) as printed is an ellipse whose axes are the image's. A fitted ellipse is rotated by an angle alpha,
  which is arbitrary for a near circle and jumps from frame to frame. The points are therefore taken at the
  parameter theta_n - alpha and rotated by alpha: the virtual points keep their places for every alpha.
- theta_1 is the azimuth of the ring's first bead in the reference frames (averaged over all beads of the
  ring, which are evenly spaced), t_n the ring's number of beads.
- A ring of fewer than `MIN_ELLIPSE_BEADS` beads (the bead at the apex) has no ellipse; its beads are the
  virtual points.
- Triangles are those of the reference frames: labels are fixed, so each triangle is compared with itself.
"""

from __future__ import annotations

import cv2
import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Indices, Mask
from palpate_edge.common.errors import CalibrationError
from palpate_edge.geometry.triangulation import delaunay

MIN_ELLIPSE_BEADS = 6
MIN_RING_SHARE = 0.5  # of a ring's beads that must be found for its ellipse to be trusted


class VirtualPoints(msgspec.Struct, frozen=True):
    """The virtual points of one frame.

    position_px (n, 2); ellipses: (x, y, width, height, angle_deg) of each ring that has one, as
    cv2.fitEllipse returns it; trusted (n,): False where too few beads of a ring were found, and the points
    are the reference's.
    """

    position_px: Array
    ellipses: tuple[tuple[float, float, float, float, float], ...]
    trusted: Mask


class VirtualPointMesh:
    """The rings, virtual points and triangles of one sensor.

    triangles (m, 3): indices into the virtual points. ring_of (n,): each virtual point's ring.
    reference_px (n, 2): virtual points of the untouched sensor.
    """

    def __init__(self, reference_px: Array, ring_of: Indices) -> None:
        """reference_px (n, 2): the untouched beads; ring_of (n,): each bead's ring.

        Raises CalibrationError when no ring has enough beads for an ellipse.
        """
        self.ring_of = ring_of
        self._beads_of = [np.flatnonzero(ring_of == ring) for ring in np.unique(ring_of)]
        if not any(len(beads) >= MIN_ELLIPSE_BEADS for beads in self._beads_of):
            raise CalibrationError(
                f"no ring has {MIN_ELLIPSE_BEADS} beads or more, so no ellipse can be fitted: "
                "give markers.rings in sensor.toml"
            )
        self._beads_px = reference_px
        self._first_angle = [_first_angle(reference_px[beads]) for beads in self._beads_of]
        self.reference_px = reference_px  # points() below replaces it by points on ellipses
        self.reference_px = self.points(reference_px, np.ones(len(reference_px), dtype=np.bool_)).position_px
        self.triangles = delaunay(self.reference_px)
        self._average = _vertex_average(self.triangles, len(reference_px))
        self._reference_area = self._areas(self.reference_px)

    def points(self, beads_px: Array, found: Mask) -> VirtualPoints:
        """Return the virtual points of one frame's beads (n, 2), of which `found` (n,) were measured.

        The others, predicted from their neighbours, count only in a ring with too few measured ones.
        """
        position = self.reference_px.copy()
        trusted = np.zeros(len(position), dtype=np.bool_)
        ellipses = []
        for beads, first_angle in zip(self._beads_of, self._first_angle, strict=True):
            seen = beads[found[beads]]
            if len(beads) < MIN_ELLIPSE_BEADS:
                position[seen] = beads_px[seen]
                trusted[seen] = True
            elif len(seen) >= MIN_RING_SHARE * len(beads):
                ellipse = fit_ellipse(beads_px[seen if len(seen) >= MIN_ELLIPSE_BEADS else beads])
                position[beads] = ellipse_points(ellipse, first_angle, len(beads))
                trusted[beads] = True
                ellipses.append(ellipse)
        return VirtualPoints(position, tuple(ellipses), trusted)

    def area_change(self, points: VirtualPoints) -> Array:
        """Return the relative change (n,) of the mean area of the triangles about each virtual point."""
        return np.asarray(self._areas(points.position_px) / self._reference_area - 1.0)

    def neighbours(self, point: int) -> Indices:
        """Return the virtual points that share a triangle with `point` (the paper's vp_2..vp_7)."""
        touching = self.triangles[(self.triangles == point).any(axis=1)]
        return np.setdiff1d(touching, [point]).astype(np.intp)

    def ring_neighbours(self, point: int) -> tuple[int, int]:
        """Return the points before and after `point` on its ring (P_nc-1, P_nc+1 of Eq. 3).

        A point that is a ring of its own has two opposite points of the next ring instead.
        """
        ring = np.flatnonzero(self.ring_of == self.ring_of[point])
        if len(ring) < 3:
            around = self.neighbours(point)
            return int(around[0]), int(around[len(around) // 2])
        place = int(np.flatnonzero(ring == point)[0])
        return int(ring[place - 1]), int(ring[(place + 1) % len(ring)])

    def _areas(self, points_px: Array) -> Array:
        """Return the mean area (n,), px^2, of the triangles about each point."""
        a, b, c = (points_px[self.triangles[:, corner]] for corner in range(3))
        ab, ac = b - a, c - a
        area = 0.5 * np.abs(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])
        return np.asarray(self._average @ area)


def fit_ellipse(points_px: Array) -> tuple[float, float, float, float, float]:
    """Fit an ellipse to points (n, 2) by least squares: centre x, y, full axes, angle in degrees."""
    (x, y), (width, height), angle_deg = cv2.fitEllipse(points_px.astype(np.float32))
    return x, y, width, height, angle_deg


def ellipse_points(
    ellipse: tuple[float, float, float, float, float], first_angle_rad: float, count: int
) -> Array:
    """Return `count` points (count, 2) on the ellipse, the first at `first_angle_rad` from +x (Eq. 1)."""
    x, y, width, height, angle_deg = ellipse
    alpha = np.radians(angle_deg)
    theta = first_angle_rad + 2 * np.pi * np.arange(count) / count - alpha  # Eq. (1a)
    along, across = width / 2 * np.cos(theta), height / 2 * np.sin(theta)  # Eq. (1b)
    cos, sin = np.cos(alpha), np.sin(alpha)
    return np.stack([x + cos * along - sin * across, y + sin * along + cos * across], axis=1)


def _first_angle(ring_px: Array) -> float:
    """Return the azimuth of a ring's first bead about the ring's centre, rad.

    All beads are averaged, each turned back by its number of spacings: no single bead's place decides.
    """
    count = len(ring_px)
    x, y = (ring_px - ring_px.mean(axis=0)).T
    back = np.arctan2(y, x) - 2 * np.pi * np.arange(count) / count
    return float(np.angle(np.exp(1j * back).sum()))


def _vertex_average(triangles: Indices, count: int) -> Array:
    """Return the matrix (count, m) that averages over the triangles about each point."""
    matrix = np.zeros((count, len(triangles)))
    for corner in range(3):
        matrix[triangles[:, corner], np.arange(len(triangles))] = 1.0
    return np.asarray(matrix / np.maximum(matrix.sum(axis=1, keepdims=True), 1.0))
