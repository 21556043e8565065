"""Where a bead appears: an ellipsoid's outline in the picture, for all beads at once."""

from __future__ import annotations

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from palpate_edge.sensor import Camera, CameraPose, View

Array = NDArray[np.float64]

CORNERS = 12  # of the polygon that goes through the lens
ROUND = 3 / (2 + np.cos(2 * np.pi / CORNERS))  # an ellipse's second moments over those of the polygon in it


class BeadProjector:
    """Outlines of one camera's beads.

    An ellipsoid of centre c and squared half axes M (both in the camera's frame) has the outline whose dual
    conic is c c^T - M (Hartley, Zisserman, Multiple View Geometry, Eq. 8.5): exact in the normalised plane.
    The lens bends it a little; the ellipse of the same middle and second moments is taken.
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
        """centre_mm (n, 3) and normal (n, 3) in F, across_mm (n,) half axis across the normal, flatness times
        it along the normal -> centre_px (n, 2) and shape (n, 2, 2): u inside where u^T shape^-1 u <= 1.
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
        """From the normalised plane to pixels: (n, 2) and (n, 2, 2) -> the same."""
        angle = 2 * np.pi * np.arange(CORNERS) / CORNERS
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        plane = (middle[:, None] + circle @ np.linalg.cholesky(flat).transpose(0, 2, 1)).reshape(-1, 2)
        pixels = self._lens.project(np.column_stack([plane, np.ones(len(plane))]))
        corner = pixels.reshape(len(middle), CORNERS, 2)
        about = corner.mean(axis=1)
        mean, second = _polygon_moments(corner - about[:, None])
        return about + mean, 4 * ROUND * second


def _polygon_moments(corner: Array) -> tuple[Array, Array]:
    """Centroid (n, 2) and central second moments (n, 2, 2) over the area of polygons (n, k, 2)."""
    following = np.roll(corner, -1, axis=1)
    cross = corner[..., 0] * following[..., 1] - corner[..., 1] * following[..., 0]
    area = cross.sum(axis=1) / 2
    both = corner + following
    mean = np.einsum("nk,nki->ni", cross, both) / (6 * area[:, None])
    squares = both[..., :, None] * both[..., None, :]
    squares += corner[..., :, None] * corner[..., None, :] + following[..., :, None] * following[..., None, :]
    second = np.einsum("nk,nkij->nij", cross, squares) / (24 * area[:, None, None])
    return mean, second - mean[:, :, None] * mean[:, None, :]
