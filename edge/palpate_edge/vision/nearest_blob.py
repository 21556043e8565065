"""Nearest blob of many places at once, by one product of matrices."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate_edge.common.arrays import Array, Floats, Indices

NO_BLOB = -1


class KnownBlobs(NamedTuple):
    """Blobs (n,) of the same beads in the round before.

    near_squared (n,): squared distance, px^2, from such a blob, within which a place has no nearer one.
    """

    blob: Indices
    near_squared: Array


class NearestBlob:
    """Looks up the nearest of one frame's blobs.

    |p - q|^2 = |p|^2 - 2 p q + |q|^2, of which |p|^2 is the same for all blobs q of a place p. In single
    precision, with the blobs' centre as origin, distances that differ by 0.02 px are distinguished.
    """

    def __init__(self, blob_px: Array) -> None:
        """blob_px (m, 2), at least one."""
        self._blob_px = blob_px
        self._centre_px = blob_px.sum(axis=0) / len(blob_px)
        centred: Floats = (blob_px - self._centre_px).astype(np.float32)
        self._to_products = np.empty((3, len(blob_px)), np.float32)
        np.multiply(centred.T, -2.0, out=self._to_products[:2])
        np.vecdot(centred, centred, out=self._to_products[2])

    def look_up(self, place_px: Array) -> tuple[Indices, Array]:
        """Return the nearest blob (n,) of each place (n, 2), and the squared distance to it, px^2."""
        factors = np.ones((len(place_px), 3), np.float32)
        np.subtract(place_px, self._centre_px, out=factors[:, :2], casting="same_kind")
        blob = (factors @ self._to_products).argmin(axis=1)
        apart = self._blob_px[blob] - place_px
        return blob, np.asarray(np.vecdot(apart, apart))

    def assign(self, place_px: Array, gate_squared: Array, known: KnownBlobs | None = None) -> Indices:
        """Return for each place (n, 2) its blob (n,), or NO_BLOB; a blob goes to the nearest place only.

        gate_squared (n,): limit of the squared distance, px^2; known: not looked up again where near.
        """
        blob, squared = self.look_up(place_px) if known is None else self._look_up_again(place_px, known)
        partner = np.where(squared < gate_squared, blob, NO_BLOB)
        near = (partner != NO_BLOB).nonzero()[0]
        wanted = partner[near]
        if len(near) and np.bincount(wanted).max() > 1:
            near = near[np.argsort(-squared[near])]
            owner = np.empty(len(self._blob_px), np.intp)
            owner[blob[near]] = near  # of several places the last one written is the nearest
            partner[near[owner[blob[near]] != near]] = NO_BLOB
        return partner

    def _look_up_again(self, place_px: Array, known: KnownBlobs) -> tuple[Indices, Array]:
        """Return the same as :meth:`look_up`; only places (n, 2) off their known blob are searched."""
        blob = known.blob.copy()
        apart = self._blob_px[blob] - place_px
        squared = np.vecdot(apart, apart)
        others = ((squared > known.near_squared) | (blob == NO_BLOB)).nonzero()[0]
        if len(others):
            blob[others], squared[others] = self.look_up(place_px[others])
        return blob, squared
