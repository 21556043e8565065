"""The likeliest displacement of the beads, in smoothing.c."""

from __future__ import annotations

import ctypes

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.kernels.library import POINTER, address, addresses, kernel

_POINTERS = (
    "field",
    "gram",
    "variance",
    "measured_px",
    "weight",
    "inexact",
    "each",
    "normal",
    "amounts",
    "smoothed_px",
)


class _Smoothing(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_int32) for name in ("beads", "fields")),
        *((name, ctypes.c_double) for name in ("noise_px2", "noise_weight", "remainder", "least_signal")),
        *((name, POINTER) for name in _POINTERS),
    ]


class SmoothingKernel:
    """Smooths displacements of one sensor's n beads by their k typical fields."""

    def __init__(
        self,
        fields: Array,
        variance: Array,
        *,
        noise_px2: float,
        noise_weight: float,
        remainder: float,
        least_signal: float,
    ) -> None:
        """fields (2 n, k), variance (k,), remainder: see typical_fields.py; noise_px2, noise_weight,
        least_signal: see smoother.py."""
        rows, count = fields.shape
        if rows % 2 or variance.shape != (count,):
            raise ValueError(f"typical fields of {rows} rows and {count} columns, {len(variance)} variances")
        beads = rows // 2
        self._measured_px, self._weight = np.zeros((beads, 2)), np.zeros(beads)
        self._smoothed_px, self._inexact = np.zeros((beads, 2)), np.zeros(beads, np.int32)
        self._arrays = {
            "field": np.ascontiguousarray(fields),
            "gram": np.ascontiguousarray(fields.T @ fields),
            "variance": np.ascontiguousarray(variance),
            "measured_px": self._measured_px,
            "weight": self._weight,
            "each": np.zeros(beads),
            "normal": np.zeros((count, count)),
            "amounts": np.zeros(count),
            "smoothed_px": self._smoothed_px,
        }
        struct = _Smoothing(
            beads,
            count,
            noise_px2,
            noise_weight,
            remainder,
            least_signal,
            inexact=address(self._inexact, np.int32),
            **addresses(self._arrays, np.float64),
        )
        self._struct = ctypes.byref(struct)
        self._smooth = kernel("smoothing", POINTER, ctypes.c_double, ctypes.c_int32)

    def smooth(self, measured_px: Array, weight: Array, found_count: int, *, all_exact: bool) -> Array:
        """Return the likeliest displacement (n, 2), px, for the measured one (n, 2).

        weight (n,): of each bead in a mean; all_exact: whether all beads are found and exact.
        """
        np.copyto(self._measured_px, measured_px)
        np.copyto(self._weight, weight)
        self._smooth(self._struct, found_count, all_exact)
        return self._smoothed_px.copy()
