"""Blob detection: all dark spots of about a bead's size in a plane.

The detector is the determinant of the Hessian at the beads' scale: large on blobs, zero along edges, so the
dome's rim, light patches and printed lines give no response. subpixel.py then measures sub-pixel places.
"""

from __future__ import annotations

import math

import cv2
import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Floats, Indices, Mask, Plane
from palpate_edge.vision.binning import halved

SCALE_OF_DIAMETER = 0.36  # sigma of the blob filter in bead diameters
BINNED_FROM_PX = 10.0, 16.0  # blobs of these diameters are searched on pixels of two by two, four by four
COARSE_FROM_PX = 10.0, 12.0  # the same where their places are measured again
SMALL_PX = 4.0  # diameter in searched pixels; the filter of smaller blobs is made narrower
DIFFERENCE_VARIANCE = 0.6  # px^2, by which Sobel's smoothing (1/2) and a pixel's area (1/12) widen the filter
KERNEL_SIGMAS = 2.5  # half the width of the filter
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
        self._diameter_px, self._min_strength, self._most = diameter_px, min_strength, most
        self._planes: tuple[Floats, ...] = (np.empty((0, 0), np.float32),)

    def find(self, dark: Plane, halvings: int = 0) -> Blobs:
        """Return the blobs of a plane.

        halvings: how often the plane was halved before; the blobs' places are of the whole image.
        """
        wanted = max(halvings, self._halvings)
        binning = 2**wanted
        for _ in range(wanted - halvings):
            dark = halved(dark)  # OpenCV takes means of two by two much faster than of four by four
        if self._planes[0].shape != dark.shape:
            self._planes = tuple(np.empty(dark.shape, np.float32) for _ in range(4))
        smooth, xx, yy, xy = self._planes
        diameter = self._diameter_px / binning
        sigma = SCALE_OF_DIAMETER * diameter
        width = 2 * math.ceil(KERNEL_SIGMAS * sigma) + 1
        blur = math.sqrt(sigma**2 - DIFFERENCE_VARIANCE) if self._is_coarse and diameter < SMALL_PX else sigma
        np.copyto(smooth, dark)
        cv2.GaussianBlur(smooth, (width, width), blur, dst=smooth)
        cv2.Sobel(smooth, cv2.CV_32F, 2, 0, dst=xx, ksize=3)
        cv2.Sobel(smooth, cv2.CV_32F, 0, 2, dst=yy, ksize=3)
        cv2.Sobel(smooth, cv2.CV_32F, 1, 1, dst=xy, ksize=3)
        cv2.threshold(xx, 0.0, 0.0, cv2.THRESH_TOZERO, dst=xx)  # so bright spots have no positive determinant
        determinant: Floats = np.multiply(xx, yy, out=xx)
        determinant -= np.multiply(xy, xy, out=xy)
        to_strength = sigma**2 / 4  # Sobel's second difference has gain 4
        index = _peaks(
            determinant, max(1, round(0.45 * diameter)), (self._min_strength / to_strength) ** 2, yy
        )
        strength = to_strength * np.sqrt(determinant.ravel()[index]).astype(np.float64)
        order = np.argsort(-strength, kind="stable")[: self._most]
        place = _highest_points(determinant, index[order])
        place *= binning
        place += 0.5 * (binning - 1)
        return _each_once(Blobs(place, strength[order]))


def find_blobs(
    dark: Plane, diameter_px: float, min_strength: float = MIN_STRENGTH, *, most: int | None = None
) -> Blobs:
    """Return dark blobs of about `diameter_px` in one plane; see :class:`BlobDetector`."""
    return BlobDetector(diameter_px, min_strength, most).find(dark)


def strongest_other(strength: Array, taken: Indices) -> float:
    """Return the strength of the strongest of blobs (n,) that are not `taken`, at least `MIN_STRENGTH`."""
    return float(np.delete(strength, taken).max(initial=MIN_STRENGTH))


def _peaks(values: Floats, reach: int, limit: float, work: Floats) -> Indices:
    """Return the flat indices (n,) of pixels above `limit` that are highest within `reach` pixels.

    The pixels of the plane's edge are left out. work: memory of the shape of `values`.
    """
    near = cv2.getStructuringElement(cv2.MORPH_RECT, (2 * reach + 1, 2 * reach + 1))
    highest = cv2.dilate(values, near, dst=work)
    peak = values >= highest
    peak &= values > limit
    peak[0] = peak[-1] = peak[:, 0] = peak[:, -1] = False
    return np.asarray(peak.ravel().nonzero()[0])


def _each_once(blobs: Blobs) -> Blobs:
    """Return the blobs without the repetitions that a maximum between two equal pixels causes."""
    repeats = blobs.strength[1:] == blobs.strength[:-1]
    if not repeats.any():
        return blobs
    repeats &= np.abs(np.diff(blobs.position_px, axis=0)).max(axis=1) < 1.0
    kept = np.append(True, ~repeats)
    return Blobs(blobs.position_px[kept], blobs.strength[kept])


def _highest_points(values: Floats, index: Indices) -> Array:
    """Return the places (n, 2) of maxima at flat indices (n,): of parabolas through three pixels an axis."""
    flat, width = values.ravel(), values.shape[1]
    steps = np.array([[1], [width]])
    at = flat[index].astype(np.float64)
    before, after = flat[index - steps].astype(np.float64), flat[index + steps].astype(np.float64)
    curvature = np.maximum(2 * at - before - after, 1e-12)
    ahead = np.minimum(np.maximum(0.5 * (after - before) / curvature, -0.5), 0.5)
    place = np.empty((len(index), 2))
    np.add(index % width, ahead[0], out=place[:, 0])
    np.add(index // width, ahead[1], out=place[:, 1])
    return place
