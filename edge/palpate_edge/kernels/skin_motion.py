"""The motion of one sensor's skin, in skin_motion.c."""

from __future__ import annotations

import ctypes
from typing import NamedTuple

import numpy as np

from palpate_edge.common.arrays import Array, Mask
from palpate_edge.kernels.library import POINTER, address, addresses, kernel
from palpate_edge.kernels.padding import padded_length, padded_rows

MOTIONS = 6
"""Displacements that a camera makes, as in skin_motion.c."""
_POINTERS = (
    "neighbours",
    "dented",
    "modes",
    "reference_px",
    "moved_rest_px",
    "without_slopes",
    "spacing_px",
    "exact_variance",
    "position_px",
    "weight",
    "found",
    "columns",
    "sums",
    "squared_sums",
    "moved_px",
    "motion",
)


class MeasuredMotion(NamedTuple):
    """moved_px (4, n, 2): places and displacements without the drift, common part, dent; the others: see
    skin_motion.Motion."""

    moved_px: Array
    size_px: float
    roughness: float
    noise: float
    dent_size_px: float


class SkinWeights(NamedTuple):
    """Weights (n, n), row by row, of the other beads in a bead's average, in that of its neighbours alone,
    and in the average of a dent."""

    averaging: Array
    neighbours: Array
    dented: Array


class _SkinMotion(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_int32) for name in ("beads", "padded_beads")),
        *((name, POINTER) for name in _POINTERS),
    ]


class SkinMotionKernel:
    """Measures the motion of n beads, averaged over their neighbours, and what of it a moved camera makes."""

    def __init__(self, reference_px: Array, spacing_px: Array, weights: SkinWeights, modes: Array) -> None:
        """reference_px (n, 2), spacing_px (n,): of the untouched beads; modes (n, 2, 6): displacements that
        a camera makes."""
        beads = len(reference_px)
        if any(one.shape != (beads, beads) for one in weights) or spacing_px.shape != (beads,):
            raise ValueError(f"weights of the neighbours do not fit {beads} beads")
        if modes.shape != (beads, 2, MOTIONS):
            raise ValueError(f"modes {modes.shape} do not fit {beads} beads")
        padded = padded_length(beads)
        self._position_px, self._weight = np.zeros((beads, 2)), np.zeros(beads)
        self._found, self._motion = np.zeros(beads, np.bool_), np.zeros(4)
        self._moved_px = np.zeros((4, beads, 2))
        self._moved_rest_px, self._without_slopes = np.array(reference_px), np.tile(np.eye(2), (beads, 1, 1))
        averaging = weights.averaging
        singles = {
            "neighbours": padded_rows(np.stack([averaging.T, weights.neighbours.T], axis=1)),
            "dented": padded_rows(weights.dented.T),
            "columns": np.zeros((3, beads), np.float32),
            "sums": np.zeros((3, 2, padded), np.float32),
            "squared_sums": np.zeros(padded, np.float32),
        }
        doubles = {
            "modes": np.ascontiguousarray(modes),
            "reference_px": np.ascontiguousarray(reference_px),
            "moved_rest_px": self._moved_rest_px,
            "without_slopes": self._without_slopes,
            "spacing_px": np.ascontiguousarray(spacing_px),
            "exact_variance": (averaging**2).sum(axis=1) / averaging.sum(axis=1) ** 2,
            "position_px": self._position_px,
            "weight": self._weight,
            "moved_px": self._moved_px,
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

    def drift(self, moved_rest_px: Array, without_slopes: Array) -> None:
        """Measure without this drift from now on.

        moved_rest_px (n, 2): of the untouched beads with the drift; without_slopes (n, 2, 2): from a bead's
        displacement to that without the drift.
        """
        np.copyto(self._moved_rest_px, moved_rest_px)
        np.copyto(self._without_slopes, without_slopes)

    def measure(self, position_px: Array, weight: Array, found: Mask, *, all_exact: bool) -> MeasuredMotion:
        """Return the motion of the found beads.

        position_px (n, 2); weight (n,): of each bead in a mean, 0 where it was not `found` (n,); all_exact:
        whether all are found and exact.
        """
        np.copyto(self._position_px, position_px)
        np.copyto(self._weight, weight)
        np.copyto(self._found, found)
        self._measure(self._struct, all_exact)
        return MeasuredMotion(self._moved_px.copy(), *self._motion.tolist())
