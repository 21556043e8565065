"""Blob detection: all dark spots of about a bead's size in a plane, to a pixel.

The detector is the determinant of the Hessian at the beads' scale: large on blobs, zero along edges, so the
dome's rim, light patches and printed lines give no response. subpixel.py then measures sub-pixel places.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from palpate_edge.common.arrays import Array, Plane

SCALE_OF_DIAMETER = 0.36  # sigma of the blob filter in bead diameters


@dataclass(frozen=True, slots=True)
class Blobs:
    """Blobs of one frame, strongest first: position_px (n, 2), strength (n,) in grey levels."""

    position_px: Array
    strength: Array


def find_blobs(dark: Plane, diameter_px: float) -> Blobs:
    """Return all dark blobs of about `diameter_px` in a plane.

    Strength is the scale-normalised root of the Hessian's determinant, about the blob's depth in grey levels.
    """
    sigma = SCALE_OF_DIAMETER * diameter_px
    smooth = cv2.GaussianBlur(dark.astype(np.float32), (0, 0), sigma)
    xx = cv2.Sobel(smooth, cv2.CV_32F, 2, 0, ksize=3)
    yy = cv2.Sobel(smooth, cv2.CV_32F, 0, 2, ksize=3)
    xy = cv2.Sobel(smooth, cv2.CV_32F, 1, 1, ksize=3)
    determinant = xx * yy - xy * xy
    determinant[(determinant < 0) | (xx + yy <= 0)] = 0
    response = np.sqrt(determinant) * np.float32(sigma**2 / 4)  # Sobel's second difference has gain 4
    reach = max(1, round(0.6 * diameter_px))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    peak = (response >= cv2.dilate(response, kernel)) & (response > 1.0)
    peak[[0, -1], :] = False
    peak[:, [0, -1]] = False
    rows, columns = np.nonzero(peak)
    strength = response[rows, columns].astype(np.float64)
    order = np.argsort(-strength, kind="stable")
    return Blobs(np.stack([columns, rows], axis=1).astype(np.float64)[order], strength[order])
