"""Map from every place of an image to the nearest blob, so that thousands of places are looked up at once."""

from __future__ import annotations

import cv2
import numpy as np

from palpate_edge.common.arrays import Array, Indices

CELL_PX = 4.0  # of the map; blobs that share a cell are nearer to each other than any two beads
NO_BLOB = -1


class NearestBlob:
    """Looks up the nearest of one frame's blobs.

    The map is a distance transform with labels over cells of 4 pixels. Its answer is the nearest blob, or
    one that is at most a cell farther away: within half a bead spacing there is only one.
    """

    def __init__(self, blob_px: Array, shape: tuple[int, int]) -> None:
        """blob_px (m, 2), at least one; shape: height and width of the image."""
        self._blob_px = blob_px
        rows, columns = (int(size / CELL_PX) + 1 for size in shape)
        self._last_cell = np.array([columns - 1, rows - 1])
        free = np.ones((rows, columns), np.uint8)
        cell = self._cells(blob_px)
        free[cell[:, 1], cell[:, 0]] = 0
        _, label = cv2.distanceTransformWithLabels(free, cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL)
        blob_of = np.zeros(int(label.max()) + 1, np.intp)
        blob_of[label[cell[:, 1], cell[:, 0]]] = np.arange(len(blob_px))
        self._nearest = blob_of[label]

    def _cells(self, place_px: Array) -> Indices:
        cell = (place_px * (1 / CELL_PX)).astype(np.intp)
        return np.asarray(np.minimum(np.maximum(cell, 0), self._last_cell))

    def look_up(self, place_px: Array) -> tuple[Indices, Array]:
        """Return the nearest blob (...) of each place (..., 2), and the squared distance to it, px^2."""
        cell = self._cells(place_px)
        blob = self._nearest[cell[..., 1], cell[..., 0]]
        apart = self._blob_px[blob] - place_px
        return blob, np.asarray(np.vecdot(apart, apart))

    def assign(self, place_px: Array, gate_squared: Array) -> Indices:
        """Return for each place (n, 2) its blob (n,), or NO_BLOB; a blob goes to the nearest place only.

        gate_squared (n,): limit of the squared distance, px^2.
        """
        blob, squared = self.look_up(place_px)
        near = np.flatnonzero(squared < gate_squared)
        near = near[np.argsort(-squared[near])]
        owner = np.full(len(self._blob_px), -1)
        owner[blob[near]] = near  # of several places the last one written is the nearest
        taken = np.flatnonzero(owner >= 0)
        partner = np.full(len(place_px), NO_BLOB)
        partner[owner[taken]] = taken
        return partner
