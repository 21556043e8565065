"""The largest variance at a bead that is not seen exactly, in blind_spot.c."""

from __future__ import annotations

import ctypes

import numpy as np

from palpate_edge.common.arrays import Array, Floats, Mask
from palpate_edge.kernels.library import POINTER, address, addresses, kernel


class _BlindSpot(ctypes.Structure):
    _fields_ = [
        ("beads", ctypes.c_int32),
        ("bead_noise", ctypes.c_double),
        *((name, POINTER) for name in ("inverse", "found", "noise", "some", "matrix", "row", "variance")),
    ]


class BlindSpotKernel:
    """Computes how well one sensor's exact beads determine the others."""

    def __init__(self, inverse: Array, bead_noise: float) -> None:
        """inverse (n, n): of the beads' covariance plus bead_noise on its diagonal."""
        count = len(inverse)
        if inverse.shape != (count, count):
            raise ValueError(f"inverse covariance of the beads is {inverse.shape}")
        self._bead_noise = bead_noise
        self._found, self._noise = np.zeros(count, np.bool_), np.ones(count, np.float32)
        self._variance = np.zeros(1)
        doubles = {
            "inverse": np.ascontiguousarray(inverse),
            "matrix": np.zeros((count, count)),
            "row": np.zeros(count),
            "variance": self._variance,
        }
        self._some = np.zeros(count, np.int32)
        self._doubles = doubles
        struct = _BlindSpot(
            count,
            bead_noise,
            found=address(self._found, np.bool_),
            noise=address(self._noise, np.float32),
            some=address(self._some, np.int32),
            **addresses(doubles, np.float64),
        )
        self._struct = ctypes.byref(struct)
        self._largest = kernel("blind_spot", POINTER)

    def largest_variance(self, found: Mask, noise: Floats | None) -> float:
        """Return the largest variance at a bead that is not found or inexact, given the others, 0 to 1.

        found (n,); noise (n,): standard deviation of each place over an exact one's, None where it is 1 for
        all. It is 0 where all beads are found and exact.
        """
        np.copyto(self._found, found)
        np.copyto(self._noise, 1.0 if noise is None else noise)
        if not self._largest(self._struct):
            return 0.0
        return float(self._variance[0]) - self._bead_noise
