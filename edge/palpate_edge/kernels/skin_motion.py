"""The motion of one sensor's skin, in skin_motion.c."""

from __future__ import annotations

import ctypes
from typing import NamedTuple

import numpy as np

from palpate_edge.common.arrays import Array, Mask
from palpate_edge.kernels.library import POINTER, address, addresses, kernel
from palpate_edge.kernels.padding import padded_length, padded_rows

_POINTERS = (
    "neighbours",
    "reference_px",
    "spacing_px",
    "exact_variance",
    "position_px",
    "weight",
    "found",
    "columns",
    "sums",
    "squared_sums",
    "displacement_px",
    "motion",
)


class MeasuredMotion(NamedTuple):
    """displacement_px (n, 2) of the beads; the others: see skin_motion.Motion."""

    displacement_px: Array
    size_px: float
    roughness: float
    noise: float


class _SkinMotion(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_int32) for name in ("beads", "padded_beads")),
        *((name, POINTER) for name in _POINTERS),
    ]


class SkinMotionKernel:
    """Measures the motion of n beads, averaged over their neighbours."""

    def __init__(self, reference_px: Array, spacing_px: Array, averaging: Array, neighbours: Array) -> None:
        """reference_px (n, 2), spacing_px (n,): of the untouched beads.

        averaging, neighbours (n, n): weights, row by row, of the other beads in a bead's average, and in that
        of its neighbours alone.
        """
        beads = len(reference_px)
        if not averaging.shape == neighbours.shape == (beads, beads) or spacing_px.shape != (beads,):
            raise ValueError(f"weights of the neighbours do not fit {beads} beads")
        padded = padded_length(beads)
        self._position_px, self._weight = np.zeros((beads, 2)), np.zeros(beads)
        self._found, self._motion = np.zeros(beads, np.bool_), np.zeros(3)
        self._displacement_px = np.zeros((beads, 2))
        singles = {
            "neighbours": padded_rows(np.stack([averaging.T, neighbours.T], axis=1)),
            "columns": np.zeros((3, beads), np.float32),
            "sums": np.zeros((3, 2, padded), np.float32),
            "squared_sums": np.zeros(padded, np.float32),
        }
        doubles = {
            "reference_px": np.ascontiguousarray(reference_px),
            "spacing_px": np.ascontiguousarray(spacing_px),
            "exact_variance": (averaging**2).sum(axis=1) / averaging.sum(axis=1) ** 2,
            "position_px": self._position_px,
            "weight": self._weight,
            "displacement_px": self._displacement_px,
            "motion": self._motion,
        }
        self._arrays = singles, doubles
        struct = _SkinMotion(
            beads,
            padded,
            found=address(self._found, np.bool_),
            **addresses(singles, np.float32),
            **addresses(doubles, np.float64),
        )
        self._struct = ctypes.byref(struct)
        self._measure = kernel("skin_motion", POINTER, ctypes.c_int32)

    def measure(self, position_px: Array, weight: Array, found: Mask, *, all_exact: bool) -> MeasuredMotion:
        """Return the motion of the found beads.

        position_px (n, 2); weight (n,): of each bead in a mean; all_exact: whether all are found and exact.
        """
        np.copyto(self._position_px, position_px)
        np.copyto(self._weight, weight)
        np.copyto(self._found, found)
        self._measure(self._struct, all_exact)
        size_px, roughness, noise = self._motion.tolist()
        return MeasuredMotion(self._displacement_px.copy(), size_px, roughness, noise)
