"""Nearest blob of many places at once, by one product of matrices."""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array, Floats, Indices

NO_BLOB = -1


class NearestBlob:
    """Looks up the nearest of one frame's blobs.

    |p - q|^2 = |p|^2 - 2 p q + |q|^2, of which |p|^2 is the same for all blobs q of a place p. In single
    precision, with the blobs' centre as origin, distances that differ by 0.02 px are distinguished.
    """

    def __init__(self, blob_px: Array) -> None:
        """blob_px (m, 2), at least one."""
        self._blob_px = blob_px
        self._centre_px = blob_px.mean(axis=0)
        centred: Floats = (blob_px - self._centre_px).astype(np.float32)
        self._to_products = np.ascontiguousarray(-2.0 * centred.T)
        self._squared = np.vecdot(centred, centred)
        self._nobody = np.full(len(blob_px), NO_BLOB)

    def look_up(self, place_px: Array) -> tuple[Indices, Array]:
        """Return the nearest blob (n,) of each place (n, 2), and the squared distance to it, px^2."""
        products = (place_px - self._centre_px).astype(np.float32) @ self._to_products
        products += self._squared
        blob = products.argmin(axis=1)
        apart = self._blob_px[blob] - place_px
        return blob, np.asarray(np.vecdot(apart, apart))

    def assign(self, place_px: Array, gate_squared: Array) -> Indices:
        """Return for each place (n, 2) its blob (n,), or NO_BLOB; a blob goes to the nearest place only.

        gate_squared (n,): limit of the squared distance, px^2.
        """
        blob, squared = self.look_up(place_px)
        near = np.flatnonzero(squared < gate_squared)
        near = near[np.argsort(-squared[near])]
        owner = self._nobody.copy()
        owner[blob[near]] = near  # of several places the last one written is the nearest
        taken = np.flatnonzero(owner >= 0)
        partner = np.full(len(place_px), NO_BLOB)
        partner[owner[taken]] = taken
        return partner
