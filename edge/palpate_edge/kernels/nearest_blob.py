"""Nearest blob of a place: the blobs of a frame in square cells, so that few are compared with each place."""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.arrays import Array, Indices
from palpate_edge.kernels.library import POINTER, address, kernel

NO_BLOB = -1
SIDE = 16  # cells in a row: about as many cells as a frame has blobs


class BlobGridFields(ctypes.Structure):
    """Mirror of `struct blob_grid`."""

    _fields_ = (
        ("side", ctypes.c_int32),
        ("count", ctypes.c_int32),
        ("left_px", ctypes.c_double),
        ("top_px", ctypes.c_double),
        ("cell_px", ctypes.c_double),
        ("blob_px", POINTER),
        ("first", POINTER),
        ("cell", POINTER),
        ("number", POINTER),
        ("sorted_px", POINTER),
        ("owner", POINTER),
    )


class BlobGrid:
    """Blobs of one frame after the other; memory for more is made when a frame has more.

    blob_px (capacity, 2): places, of which the first ones are the frame's.
    """

    def __init__(self) -> None:
        self._first = np.zeros(SIDE * SIDE + 1, np.int32)
        self.fields = BlobGridFields(side=SIDE, first=address(self._first, np.int32))
        self._load = kernel("blob_grid_load", POINTER, ctypes.c_int32)
        self._look_up = kernel("blob_grid_look_up", POINTER, ctypes.c_int32, *[POINTER] * 3)
        self._assign = kernel("blob_grid_assign", POINTER, ctypes.c_int32, *[POINTER] * 4)
        self.reserve(0)

    def reserve(self, count: int) -> None:
        """Make memory for `count` blobs; those of before are lost."""
        self.blob_px = np.zeros((count, 2))
        self._sorted_px = np.zeros((count, 2))
        self._numbers = np.zeros((3, count), np.int32)
        fields = self.fields
        fields.blob_px, fields.sorted_px = (
            address(array, np.float64) for array in (self.blob_px, self._sorted_px)
        )
        fields.cell, fields.number, fields.owner = (address(array, np.int32) for array in self._numbers)
        fields.count = 0

    def load(self, blob_px: Array) -> None:
        """Take the blobs (m, 2) of a frame."""
        count = len(blob_px)
        if count > len(self.blob_px):
            self.reserve(count)
        np.copyto(self.blob_px[:count], blob_px)
        self._load(ctypes.byref(self.fields), count)

    def look_up(self, place_px: Array) -> tuple[Indices, Array]:
        """Return the nearest blob (n,) of each place (n, 2), and the squared distance to it, px^2."""
        places, blob, squared = _arrays(place_px)
        self._look_up(
            ctypes.byref(self.fields),
            len(places),
            address(places, np.float64),
            address(blob, np.int32),
            address(squared, np.float64),
        )
        return blob.astype(np.intp), squared

    def assign(self, place_px: Array, gate_squared: Array) -> Indices:
        """Return for each place (n, 2) its blob (n,), or NO_BLOB; a blob is given to the nearest place only.

        gate_squared (n,): limit of the squared distance, px^2.
        """
        places, blob, squared = _arrays(place_px)
        gate = np.ascontiguousarray(np.broadcast_to(gate_squared, len(places)), np.float64)
        self._assign(
            ctypes.byref(self.fields),
            len(places),
            address(places, np.float64),
            address(gate, np.float64),
            address(blob, np.int32),
            address(squared, np.float64),
        )
        return blob.astype(np.intp)


def _arrays(place_px: Array) -> tuple[Array, NDArray[np.int32], Array]:
    """Return places as the kernel reads them, and memory for their blobs and squared distances."""
    places = np.ascontiguousarray(place_px, np.float64).reshape(-1, 2)
    return places, np.empty(len(places), np.int32), np.empty(len(places))
