"""Nearest blob of many places at once, and which of several places a blob is given to."""

from __future__ import annotations

from palpate_edge.common.arrays import Array, Indices
from palpate_edge.kernels.nearest_blob import NO_BLOB, BlobGrid

__all__ = ["NO_BLOB", "NearestBlob"]


class NearestBlob:
    """Looks up the nearest of one frame's blobs.

    The blobs are sorted into square cells: a place is compared with those of the nine cells about it, and
    with further ones only where no blob is that near.
    """

    def __init__(self, blob_px: Array) -> None:
        """blob_px (m, 2), at least one."""
        self._grid = BlobGrid()
        self._grid.load(blob_px)

    def look_up(self, place_px: Array) -> tuple[Indices, Array]:
        """Return the nearest blob (n,) of each place (n, 2), and the squared distance to it, px^2."""
        return self._grid.look_up(place_px)

    def assign(self, place_px: Array, gate_squared: Array) -> Indices:
        """Return for each place (n, 2) its blob (n,), or NO_BLOB; a blob goes to the nearest place only.

        gate_squared (n,): limit of the squared distance, px^2.
        """
        return self._grid.assign(place_px, gate_squared)
