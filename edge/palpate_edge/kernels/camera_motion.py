"""The displacement that a moved camera makes, and the dent that remains, in camera_motion.c."""

from __future__ import annotations

import ctypes

import numpy as np

from palpate_edge.common.arrays import Array, Mask
from palpate_edge.kernels.library import POINTER, address, addresses, kernel
from palpate_edge.kernels.padding import padded_length, padded_rows

MOTIONS = 6
"""Columns of the modes, as in camera_motion.c."""
_POINTERS = (
    "modes",
    "neighbours",
    "displacement_px",
    "weight",
    "found",
    "columns",
    "sums",
    "common_px",
    "dent_px",
    "size_px",
)


class _CameraMotion(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_int32) for name in ("beads", "padded_beads")),
        *((name, POINTER) for name in _POINTERS),
    ]


class CameraMotionKernel:
    """Splits displacements of n beads into a common part and a dent, and measures dents."""

    def __init__(self, modes: Array, averaging: Array) -> None:
        """modes (n, 2, 6): displacements that a camera makes; averaging (n, n): weights, row by row, of the
        other beads in a bead's average."""
        beads = len(modes)
        if modes.shape != (beads, 2, MOTIONS) or averaging.shape != (beads, beads):
            raise ValueError(f"modes {modes.shape} and weights {averaging.shape} of the beads do not fit")
        padded = padded_length(beads)
        self._displacement_px, self._weight = np.zeros((beads, 2)), np.zeros(beads)
        self._found, self._size_px = np.zeros(beads, np.bool_), np.zeros(1)
        self._common_px, self._dent_px = np.zeros((beads, 2)), np.zeros((beads, 2))
        singles = {
            "neighbours": padded_rows(averaging.T),
            "columns": np.zeros((3, beads), np.float32),
            "sums": np.zeros((3, padded), np.float32),
        }
        doubles = {
            "modes": np.ascontiguousarray(modes),
            "displacement_px": self._displacement_px,
            "weight": self._weight,
            "common_px": self._common_px,
            "dent_px": self._dent_px,
            "size_px": self._size_px,
        }
        self._arrays = singles, doubles
        struct = _CameraMotion(
            beads,
            padded,
            found=address(self._found, np.bool_),
            **addresses(singles, np.float32),
            **addresses(doubles, np.float64),
        )
        self._struct = ctypes.byref(struct)
        self._split = kernel("camera_motion", POINTER)
        self._measure = kernel("dent_size", POINTER)

    def split(self, displacement_px: Array, weight: Array, found: Mask) -> tuple[Array, Array]:
        """Return the common part (n, 2) of a displacement (n, 2), by least squares, and the dent (n, 2).

        The dent is 0 for beads that were not found.
        weight (n,): of each bead, 0 where it was not `found` (n,).
        """
        np.copyto(self._displacement_px, displacement_px)
        np.copyto(self._weight, weight)
        np.copyto(self._found, found)
        self._split(self._struct)
        return self._common_px.copy(), self._dent_px.copy()

    def size_px(self, dent_px: Array, weight: Array, found: Mask) -> float:
        """Return the root mean square, over the found beads, of the dent averaged over their neighbours."""
        np.copyto(self._dent_px, dent_px)
        np.copyto(self._weight, weight)
        np.copyto(self._found, found)
        self._measure(self._struct)
        return float(self._size_px[0])
