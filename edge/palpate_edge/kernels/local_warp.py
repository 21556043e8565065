"""Local warp: sums over each bead's neighbours and the affine map that follows from them."""

from __future__ import annotations

import ctypes

import numpy as np

from palpate_edge.common.arrays import Array, Floats, Mask
from palpate_edge.kernels.library import POINTER, address, kernel

MIN_WEIGHT = 1e-6  # of all neighbours of a bead


class WarpFields(ctypes.Structure):
    """Mirror of `struct local_warp`."""

    _fields_ = (
        ("beads", ctypes.c_int32),
        ("ridge", ctypes.c_float),
        ("min_weight", ctypes.c_float),
        ("first", POINTER),
        ("neighbour", POINTER),
        ("weight", POINTER),
        ("terms", POINTER),
        ("per_all", POINTER),
        ("rows", POINTER),
        ("displacement_px", POINTER),
        ("known", POINTER),
        ("predicted_px", POINTER),
        ("support", POINTER),
    )


class WarpKernel:
    """Predicts the displacements of n beads from each other.

    Inputs are displacement_px (n, 2) and known (n,), results predicted_px (n, 2) and support (n,).
    """

    def __init__(self, place: Array, weight: Array, ridge: float) -> None:
        """place (n, 2): of the beads, in units about their centre; weight (n, n): of each bead's neighbours,
        0 of most; ridge: of the gradient, squared units."""
        count = len(place)
        bead, neighbour = np.nonzero(weight > 0.0)
        x, y = place.T.astype(np.float32)
        self._first = np.append(0, np.cumsum(np.bincount(bead, minlength=count))).astype(np.int32)
        self._neighbour = neighbour.astype(np.int32)
        self._weight = weight[bead, neighbour].astype(np.float32)
        self._terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
        self._per_all = (1.0 / np.maximum(weight.sum(axis=1), MIN_WEIGHT)).astype(np.float32)
        self._rows: Floats = np.zeros((count, 12), np.float32)
        self.displacement_px, self.predicted_px = np.zeros((count, 2)), np.zeros((count, 2))
        self.known: Mask = np.zeros(count, np.bool_)
        self.support: Floats = np.zeros(count, np.float32)
        self.fields = WarpFields(
            beads=count,
            ridge=ridge,
            min_weight=MIN_WEIGHT,
            first=address(self._first, np.int32),
            neighbour=address(self._neighbour, np.int32),
            weight=address(self._weight, np.float32),
            terms=address(self._terms, np.float32),
            per_all=address(self._per_all, np.float32),
            rows=address(self._rows, np.float32),
            displacement_px=address(self.displacement_px, np.float64),
            known=address(self.known, np.bool_),
            predicted_px=address(self.predicted_px, np.float64),
            support=address(self.support, np.float32),
        )
        self._reference = ctypes.byref(self.fields)
        self._predict = kernel("local_warp_predict", POINTER)

    def predict(self, displacement_px: Array, known: Mask) -> tuple[Array, Array]:
        """Return the displacement (n, 2) of each bead as the `known` (n,) others predict it, and the share
        (n,) of its neighbours' weight that is of known ones."""
        np.copyto(self.displacement_px, displacement_px)
        np.copyto(self.known, known)
        self._predict(self._reference)
        return self.predicted_px.copy(), self.support.astype(np.float64)
