"""Missing beads displaced like their neighbours: weighted means over the found beads."""

from __future__ import annotations

import ctypes

import numpy as np

from palpate_edge.common.arrays import Array, Indices, Mask
from palpate_edge.kernels.library import POINTER, address, kernel


class NeighbourFields(ctypes.Structure):
    """Mirror of `struct neighbourhood`."""

    _fields_ = (
        ("beads", ctypes.c_int32),
        ("least_weight", ctypes.c_double),
        ("reference_px", POINTER),
        ("weight", POINTER),
        ("position_px", POINTER),
        ("found", POINTER),
        ("missing", POINTER),
        ("moved_px", POINTER),
        ("predicted_px", POINTER),
    )


class NeighbourMeans:
    """Predicts some of n beads from the found others."""

    def __init__(self, reference_px: Array, weight: Array, least_weight: float) -> None:
        """reference_px (n, 2): the beads' places; weight (n, n): row i is of the neighbours of bead i;
        least_weight: of all found neighbours, that a mean needs."""
        count = len(reference_px)
        self._reference_px = np.array(reference_px, np.float64)
        self._weight = np.ascontiguousarray(weight, np.float64)
        self._position_px, self._predicted_px = np.zeros((count, 2)), np.zeros((count, 2))
        self._moved_px, self._found = np.zeros((count, 3)), np.zeros(count, np.bool_)
        self._missing = np.zeros(count, np.int64)
        self._fields = NeighbourFields(
            beads=count,
            least_weight=least_weight,
            reference_px=address(self._reference_px, np.float64),
            weight=address(self._weight, np.float64),
            position_px=address(self._position_px, np.float64),
            found=address(self._found, np.bool_),
            missing=address(self._missing, np.int64),
            moved_px=address(self._moved_px, np.float64),
            predicted_px=address(self._predicted_px, np.float64),
        )
        self._byref = ctypes.byref(self._fields)
        self._predict = kernel("neighbourhood_predict", POINTER, ctypes.c_int32)

    def predict(self, position_px: Array, found: Mask, missing: Indices) -> Array | None:
        """Return places (m, 2) of the `missing` beads (m,), displaced like their `found` (n,) neighbours;
        None where the found neighbours of one have less than the least weight.

        position_px (n, 2): of the found beads. Raises IndexError for a number that is that of no bead.
        """
        count = len(missing)
        np.copyto(self._missing[:count], missing)
        np.copyto(self._position_px, position_px)
        np.copyto(self._found, found)
        faint = self._predict(self._byref, count)
        if faint < 0:
            raise IndexError(f"beads {missing.tolist()} are not all of {len(self._missing)}")
        return None if faint else self._predicted_px[:count].copy()
