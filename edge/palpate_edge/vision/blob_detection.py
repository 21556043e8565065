"""Blob detection: all dark spots of about a bead's size in a plane.

The detector is the determinant of the Hessian at the beads' scale: large on blobs, zero along edges, so the
dome's rim, light patches and printed lines give no response. Blobs are its peaks, placed by parabolas through
three pixels an axis (kernels/blob_peaks.c). subpixel.py then measures sub-pixel places.
"""

from __future__ import annotations

import math

import cv2
import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Indices, Mask, Plane
from palpate_edge.kernels.blob_peaks import BlobPeaks
from palpate_edge.vision.binning import halved

SCALE_OF_DIAMETER = 0.36  # sigma of the blob filter in bead diameters
BINNED_FROM_PX = 10.0, 16.0  # blobs of these diameters are searched on pixels of two by two, four by four
COARSE_FROM_PX = 10.0, 12.0  # the same where their places are measured again
SMALL_PX = 4.0  # diameter in searched pixels; the filter of smaller blobs is made narrower
DIFFERENCE_VARIANCE = 0.6  # px^2, by which Sobel's smoothing (1/2) and a pixel's area (1/12) widen the filter
KERNEL_SIGMAS = 2.5  # half the width of the filter
REACH = 0.45  # of the diameter, within which a blob's determinant is the highest
MIN_STRENGTH = 1.0  # grey levels


class Blobs(msgspec.Struct, frozen=True):
    """Blobs of one frame, strongest first: position_px (n, 2), strength (n,) in grey levels."""

    position_px: Array
    strength: Array

    def strongest(self, count: int) -> Blobs:
        """Return at most the `count` strongest blobs."""
        return Blobs(self.position_px[:count], self.strength[:count])

    def chosen(self, which: Mask) -> Blobs:
        """Return some of the blobs (n,)."""
        return Blobs(self.position_px[which], self.strength[which])


class BlobDetector:
    """Finds dark blobs of about one diameter in a stream of planes; its memory is reused.

    Strength is the scale-normalised root of the Hessian's determinant, about the blob's depth in grey levels.
    Large blobs are searched at a half or a quarter of the resolution: their filter is then as wide as small
    blobs' is. Places are right to a few tenths of a pixel.
    """

    def __init__(
        self,
        diameter_px: float,
        min_strength: float = MIN_STRENGTH,
        most: int | None = None,
        *,
        coarse: bool = False,
    ) -> None:
        """min_strength: grey levels; most: at most so many, the strongest; None: all; coarse: search at lower
        resolution, where places are measured again."""
        self._is_coarse = coarse
        limits_px = COARSE_FROM_PX if coarse else BINNED_FROM_PX
        self._halvings = sum(diameter_px >= limit_px for limit_px in limits_px)
        self._diameter_px, self._min_strength = diameter_px, min_strength
        self._peaks = BlobPeaks(most)

    def find(self, dark: Plane, halvings: int = 0) -> Blobs:
        """Return the blobs of a plane.

        halvings: how often the plane was halved before; the blobs' places are of the whole image.
        """
        wanted = max(halvings, self._halvings)
        binning = 2**wanted
        for _ in range(wanted - halvings):
            dark = halved(dark)  # OpenCV takes means of two by two much faster than of four by four
        diameter = self._diameter_px / binning
        sigma = SCALE_OF_DIAMETER * diameter
        width = 2 * math.ceil(KERNEL_SIGMAS * sigma) + 1
        blur = math.sqrt(sigma**2 - DIFFERENCE_VARIANCE) if self._is_coarse and diameter < SMALL_PX else sigma
        smooth = self._peaks.plane((dark.shape[0], dark.shape[1]))
        np.copyto(smooth, dark)
        cv2.GaussianBlur(smooth, (width, width), blur, dst=smooth)
        to_strength = sigma**2 / 4  # Sobel's second difference has gain 4
        limit = (self._min_strength / to_strength) ** 2
        reach = max(1, round(REACH * diameter))
        return Blobs(*self._peaks.find(reach, limit, to_strength, binning))


def find_blobs(
    dark: Plane, diameter_px: float, min_strength: float = MIN_STRENGTH, *, most: int | None = None
) -> Blobs:
    """Return dark blobs of about `diameter_px` in one plane; see :class:`BlobDetector`."""
    return BlobDetector(diameter_px, min_strength, most).find(dark)


def strongest_other(strength: Array, taken: Indices) -> float:
    """Return the strength of the strongest of blobs (n,) that are not `taken`, at least `MIN_STRENGTH`."""
    return float(np.delete(strength, taken).max(initial=MIN_STRENGTH))
