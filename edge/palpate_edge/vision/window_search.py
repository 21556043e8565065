"""Search of beads in small windows around the places where they are expected."""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array, Floats, Indices, Mask, Plane
from palpate_edge.vision.beads import Reference
from palpate_edge.vision.subpixel import Refined, Refiner

MIN_CONTRAST_SHARE = 0.35  # of the bead's contrast in the reference frames
AREA_RANGE = (0.45, 1.9)  # of the bead's area in the reference frames
MAX_ADDED_UNEVENNESS = 0.08  # of the contrast, over the reference frames'; JPEG and blur add less than 0.06
MIN_BLOB_CONTRAST_SHARE = 0.1  # the same, of a blob that was matched with the bead
MAX_BLOB_STEP = 0.35  # of the spacing, from that blob
MAX_STEP = 0.45  # of the spacing, from the expected place


class WindowSearch:
    """Measures one reference's beads near expected places and accepts those that look as in the reference."""

    def __init__(self, reference: Reference) -> None:
        spacing_px = reference.neighbourhood.spacing_px
        self._refiner = Refiner(reference.diameter_px, spacing_px, reference.shading)
        self._acceptance = _Acceptance(reference)

    def load(self, dark: Plane) -> None:
        """Take the plane in which :meth:`find_beads` searches until the next one is loaded."""
        self._refiner.load(dark)

    def find_beads(self, expected_px: Array, beads: Indices | None = None) -> tuple[Array, Mask]:
        """Return places (m, 2) of `beads` (m,), all if None, and which of them (m,) were found.

        expected_px (m, 2): where the windows are placed.
        """
        refined = self._refiner.centroids(expected_px, beads)
        return refined.position_px, self._acceptance.accept(refined, expected_px, beads)

    def measure_blobs(self, blob_px: Array) -> tuple[Array, Mask]:
        """Return places (n, 2) of all beads at their blobs (n, 2), and which (n,) of them can be measured.

        The blobs are known to be the beads: dim and overexposed ones pass as well, and glare beside them.
        """
        refined = self._refiner.centroids(blob_px)
        return refined.position_px, self._acceptance.accept_blob(refined, blob_px)


class _Acceptance:
    """Compares what a window holds with the bead of the reference frames."""

    def __init__(self, reference: Reference) -> None:
        spacing_px = reference.neighbourhood.spacing_px
        self._min_contrast = (MIN_CONTRAST_SHARE * reference.contrast).astype(np.float32)
        self._min_area, self._max_area = ((share * reference.area).astype(np.float32) for share in AREA_RANGE)
        self._max_step_squared = (MAX_STEP * spacing_px) ** 2
        self._max_blob_step_squared = (MAX_BLOB_STEP * spacing_px) ** 2
        self._min_blob_contrast = (MIN_BLOB_CONTRAST_SHARE * reference.contrast).astype(np.float32)
        unevenness = np.inf if reference.unevenness is None else reference.unevenness
        self._max_unevenness = np.full(spacing_px.shape, unevenness + MAX_ADDED_UNEVENNESS, np.float32)
        self._noise_unevenness = 0.0

    def accept(self, refined: Refined, expected_px: Array, beads: Indices | None) -> Mask:
        """Return which (m,) of the refined places really show their bead."""
        chosen = slice(None) if beads is None else beads
        step = refined.position_px - expected_px
        found = refined.converged & (refined.contrast > self._min_contrast[chosen])
        found &= refined.area > self._min_area[chosen]
        found &= refined.area < self._max_area[chosen]
        found &= np.vecdot(step, step) < self._max_step_squared[chosen]
        if beads is None:
            found &= self._is_even(refined.unevenness)
        else:
            found &= refined.unevenness < self._max_unevenness[beads] + self._noise_unevenness
        return np.asarray(found)

    def accept_blob(self, refined: Refined, blob_px: Array) -> Mask:
        """Return which (n,) of the refined places still belong to their blob."""
        step = refined.position_px - blob_px
        found = np.vecdot(step, step) < self._max_blob_step_squared
        found &= refined.contrast > self._min_blob_contrast
        found &= refined.area < self._max_area
        return np.asarray(found)

    def _is_even(self, unevenness: Floats) -> Mask:
        """Return which of all beads (n,) have no glare beside them; its edge would displace the centroid.

        Unevenness that most beads share is camera noise: it is added to the limit until the next call.
        """
        even = unevenness < self._max_unevenness
        self._noise_unevenness = 0.0
        if not even.all():
            excess = unevenness - self._max_unevenness
            self._noise_unevenness = max(0.0, float(np.median(excess)) + MAX_ADDED_UNEVENNESS)
            even = excess < self._noise_unevenness
        return np.asarray(even)
