"""Spots of one frame that may be markers, to a fraction of a pixel, in no order."""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Plane
from palpate_edge.vision.blob_detection import BlobDetector, Blobs
from palpate_edge.vision.subpixel import Refiner

SPARE = 1.5  # spots that are kept, over the sensor's number of markers
STEPS = 1  # from where the spot was found, which is right to a few tenths of a pixel
MAX_REFINED_MOVE = 0.5  # marker diameters; a centroid that ran off stays where the spot was found


class SpotDetector:
    """Finds spots of one size, about `count` of them, at least `weakest_strength` strong."""

    def __init__(self, diameter_px: float, weakest_strength: float, count: int) -> None:
        self._diameter_px = diameter_px
        most = int(SPARE * count) + 1
        self._blobs = BlobDetector(diameter_px, weakest_strength, most)
        self._refiner = Refiner(np.full(most, diameter_px))

    def find(self, dark: Plane) -> Blobs:
        """Return the spots in a plane (see appearance.plane), the strongest first."""
        blobs = self._blobs.find(dark)
        rough_px = blobs.position_px
        if not len(rough_px):
            return blobs
        self._refiner.load(dark)
        place_px = self._refiner.centroids(rough_px, np.arange(len(rough_px)), STEPS).position_px
        moved = np.abs(place_px - rough_px).max(axis=1) > MAX_REFINED_MOVE * self._diameter_px
        return Blobs(np.where(moved[:, None], rough_px, place_px), blobs.strength)
