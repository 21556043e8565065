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
        ("relative", POINTER),
        ("position_px", POINTER),
        ("found", POINTER),
        ("missing", POINTER),
        ("moved_px", POINTER),
        ("predicted_px", POINTER),
    )


class NeighbourMeans:
    """Predicts some of n beads from the found others.

    struct: the means for other kernels, as long as this object is kept.
    """

    def __init__(self, reference_px: Array, relative: Array, least_weight: float) -> None:
        """reference_px (n, 2): the beads' places; relative (n, n): row i has the distances from bead i to the
        others, whose weights are Gaussians of them; least_weight: of all found neighbours, with less the
        weights are scaled so that the nearest has weight 1."""
        count = len(reference_px)
        self._reference_px = np.array(reference_px, np.float64)
        self._relative = np.ascontiguousarray(relative, np.float64)
        self._weight = np.exp(-0.5 * self._relative**2)
        self._position_px, self._predicted_px = np.zeros((count, 2)), np.zeros((count, 2))
        self._moved_px, self._found = np.zeros((count, 3)), np.zeros(count, np.bool_)
        self._missing = np.zeros(count, np.int64)
        self.struct = NeighbourFields(
            beads=count,
            least_weight=least_weight,
            reference_px=address(self._reference_px, np.float64),
            weight=address(self._weight, np.float64),
            relative=address(self._relative, np.float64),
            position_px=address(self._position_px, np.float64),
            found=address(self._found, np.bool_),
            missing=address(self._missing, np.int64),
            moved_px=address(self._moved_px, np.float64),
            predicted_px=address(self._predicted_px, np.float64),
        )
        self._byref = ctypes.byref(self.struct)
        self._predict = kernel("neighbourhood_predict", POINTER, ctypes.c_int32)

    def predict(self, position_px: Array, found: Mask, missing: Indices) -> Array:
        """Return places (m, 2) of the `missing` beads (m,), displaced like their `found` (n,) neighbours.

        Without any found bead these are the reference places. position_px (n, 2): of the found beads. Raises
        IndexError for a number that is that of no bead.
        """
        count = len(missing)
        np.copyto(self._missing[:count], missing)
        np.copyto(self._position_px, position_px)
        np.copyto(self._found, found)
        if self._predict(self._byref, count) < 0:
            raise IndexError(f"beads {missing.tolist()} are not all of {len(self._missing)}")
        return self._predicted_px[:count].copy()
