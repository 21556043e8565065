"""Project beads into the image: the outlines of ellipsoids, for all beads at once."""

from __future__ import annotations

import cv2
import msgspec
import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.geometry.sensor import Camera, CameraPose, View

CORNERS = 6  # corners of the inscribed polygon that is projected through the lens
# Ratios of an ellipse to its inscribed polygon: of the second moments, and of the centroid's shift under lens
# distortion. Where z = x + iy maps to z + q z^2, the ellipse's centroid shifts from the mean of the corners
# by conj(q), the polygon's by conj(q) / DISTORTION_RATIO.
MOMENT_RATIO = 3 / (2 + np.cos(2 * np.pi / CORNERS))
DISTORTION_RATIO = 1 / (1 - 4 / 3 * np.sin(np.pi / CORNERS) ** 2)


class BeadProjector:
    """Projection of beads by one camera.

    The outline of an ellipsoid with centre c and squared half axes M (both in the camera frame) has the dual
    conic c c^T - M (Hartley, Zisserman, Multiple View Geometry, Eq. 8.5), exact in the normalised plane. Lens
    distortion is approximated by the ellipse with the same centroid and second moments.
    """

    def __init__(self, camera: Camera, pose: CameraPose) -> None:
        rotation, _ = cv2.Rodrigues(np.asarray(pose.rotation_rad, dtype=np.float64))
        self._rotation = np.asarray(rotation, dtype=np.float64)
        self._position_mm = np.asarray(camera.position_mm, dtype=np.float64) + pose.offset_mm
        at_origin = msgspec.structs.replace(camera, position_mm=(0.0, 0.0, 0.0))
        self._lens = View(at_origin, CameraPose(focal_scale=pose.focal_scale))

    def outlines(
        self, centre_mm: Array, normal: Array, across_mm: Array, flatness: float
    ) -> tuple[Array, Array]:
        """Return the outlines as centre_px (n, 2) and shape (n, 2, 2): u is inside if u^T shape^-1 u <= 1.

        centre_mm (n, 3) and normal (n, 3) in F; across_mm (n,): half axis across the normal; the half axis
        along the normal is flatness times as long.
        """
        c = (centre_mm - self._position_mm) @ self._rotation
        n = normal @ self._rotation
        half2 = across_mm[:, None, None] ** 2
        m = half2 * (np.eye(3) + (flatness**2 - 1) * n[:, :, None] * n[:, None, :])
        conic = c[:, :, None] * c[:, None, :] - m
        conic = conic / conic[:, 2:, 2:]
        middle = conic[:, :2, 2]
        flat = middle[:, :, None] * middle[:, None, :] - conic[:, :2, :2]
        return self._through_lens(middle, flat)

    def _through_lens(self, middle: Array, flat: Array) -> tuple[Array, Array]:
        """Map ellipses, centre (n, 2) and shape (n, 2, 2), from the normalised plane to pixels."""
        angle = 2 * np.pi * np.arange(CORNERS) / CORNERS
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        plane = (middle[:, None] + circle @ np.linalg.cholesky(flat).transpose(0, 2, 1)).reshape(-1, 2)
        pixels = self._lens.project(np.column_stack([plane, np.ones(len(plane))]))
        corner = pixels.reshape(len(middle), CORNERS, 2)
        about = corner.mean(axis=1)
        mean, second = _polygon_moments(corner - about[:, None])
        return about + DISTORTION_RATIO * mean, 4 * MOMENT_RATIO * second


def _polygon_moments(corner: Array) -> tuple[Array, Array]:
    """Return centroid (n, 2) and central second moments (n, 2, 2) of the area of polygons (n, k, 2)."""
    x, y = corner[..., 0], corner[..., 1]
    next_x, next_y = np.roll(x, -1, axis=1), np.roll(y, -1, axis=1)
    cross = x * next_y - y * next_x
    both_x, both_y = x + next_x, y + next_y
    area = cross.sum(axis=1) / 2
    mean_x, mean_y = (np.vecdot(cross, both) / (6 * area) for both in (both_x, both_y))
    xx = np.vecdot(cross, both_x * both_x + x * x + next_x * next_x)
    xy = np.vecdot(cross, both_x * both_y + x * y + next_x * next_y)
    yy = np.vecdot(cross, both_y * both_y + y * y + next_y * next_y)
    xx, xy, yy = (second / (24 * area) for second in (xx, xy, yy))
    xx, xy, yy = xx - mean_x * mean_x, xy - mean_x * mean_y, yy - mean_y * mean_y
    return np.stack([mean_x, mean_y], axis=1), np.stack([xx, xy, xy, yy], axis=1).reshape(-1, 2, 2)
