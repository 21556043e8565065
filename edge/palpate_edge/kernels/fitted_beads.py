"""Beads at their centres of symmetry, and which of them are beads; vision/bead_fit.py has the rules."""

from __future__ import annotations

import ctypes
from ctypes import c_double, c_float, c_int32
from typing import NamedTuple

import numpy as np

from palpate_edge.common.arrays import Array, Floats, Mask
from palpate_edge.kernels.library import POINTER, address, kernel
from palpate_edge.kernels.neighbourhood import NeighbourMeans
from palpate_edge.kernels.symmetric_steps import SymmetricSteps


class FittedLimits(NamedTuple):
    """Numbers of bead_fit.py; sigma_px: of the reference's beads; the last three in px^2."""

    max_noise: float
    max_faint_noise: float
    sure_noise: float
    min_explained: float
    min_white: float
    sigma_px: float
    max_step_squared: float
    max_predicted_squared: float
    min_apart_squared: float


_FLOATS = 5  # of the limits


class _FittedBeads(ctypes.Structure):
    _fields_ = (
        *((name, POINTER) for name in ("fit", "neighbours")),
        *((name, c_int32) for name in ("beads", "binning")),
        *((name, c_float) for name in FittedLimits._fields[:_FLOATS]),
        *((name, c_double) for name in FittedLimits._fields[_FLOATS:]),
        *((name, POINTER) for name in ("diameter_px", "position_px", "found", "noise", "lost")),
    )


class FittedBeads:
    """Fits all beads of one reference in the image that the steps have."""

    def __init__(
        self,
        steps: SymmetricSteps,
        means: NeighbourMeans,
        diameter_px: Array,
        limits: FittedLimits,
        *,
        binning: int,
    ) -> None:
        """steps, means: of the same n beads; diameter_px (n,); binning: pixels of one of the steps'."""
        count = len(diameter_px)
        self._position_px, self._noise = np.zeros((count, 2)), np.zeros(count, np.float32)
        self._found, lost = np.zeros((2, count), np.bool_)
        diameter_px = np.ascontiguousarray(diameter_px, np.float64)
        self._arrays = diameter_px, self._position_px, self._found, self._noise, lost
        self._parts = steps, means
        struct = _FittedBeads(
            ctypes.addressof(steps.struct),
            ctypes.addressof(means.struct),
            count,
            binning,
            *limits,
            *(address(array, array.dtype.type) for array in self._arrays),
        )
        self._struct = ctypes.byref(struct)
        self._fit = kernel("fit_beads", POINTER, c_int32)

    def fit(self, position_px: Array, found: Mask, *, accepts_lost: bool) -> tuple[Array, Mask, Floats]:
        """Return places (n, 2) of all beads, which (n,) were found, and their noise (n,), 1 of others.

        position_px (n, 2): of the beads found (n,) before; the others are looked for where their neighbours
        predict them, and may be found where accepts_lost is set.
        """
        np.copyto(self._position_px, position_px)
        np.copyto(self._found, found)
        self._fit(self._struct, accepts_lost)
        return self._position_px.copy(), self._found.copy(), self._noise.copy()
