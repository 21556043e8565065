"""Labels: beads that jumped since the last frame, and pairs of beads at one place."""

from __future__ import annotations

import ctypes

import numpy as np

from palpate_edge.common.arrays import Array, Indices, Mask
from palpate_edge.kernels.library import POINTER, address, kernel


class LabelFields(ctypes.Structure):
    """Mirror of `struct labels`."""

    _fields_ = (
        ("beads", ctypes.c_int32),
        ("pairs", ctypes.c_int32),
        ("min_overlap_squared", ctypes.c_double),
        ("reference_px", POINTER),
        ("jump_squared", POINTER),
        ("first", POINTER),
        ("other", POINTER),
        ("overlap_squared", POINTER),
        ("position_px", POINTER),
        ("last_px", POINTER),
        ("found", POINTER),
        ("kept", POINTER),
    )


class LabelKernel:
    """Compares the places of n beads with each other and with those of the last frame."""

    def __init__(
        self,
        reference_px: Array,
        jump_squared: Array,
        pairs: tuple[Indices, Indices],
        overlap_squared: Array,
        min_overlap_squared: float,
    ) -> None:
        """reference_px (n, 2): the beads' places; jump_squared (n,): limits of the squared step, px^2; pairs
        (p,), (p,): beads that can meet; overlap_squared (p,): px^2, nearer than which they share a place;
        min_overlap_squared: px^2, of a displacement without which no beads meet."""
        count = len(reference_px)
        self._reference_px, self._jump_squared = np.array(reference_px, np.float64), jump_squared
        self._first, self._other = (ends.astype(np.int32) for ends in pairs)
        self._overlap_squared = overlap_squared.astype(np.float32)
        self._position_px, self._last_px = np.zeros((count, 2)), np.zeros((count, 2))
        self._found, self._kept = np.zeros(count, np.bool_), np.zeros(count, np.bool_)
        self._fields = LabelFields(
            beads=count,
            pairs=len(self._first),
            min_overlap_squared=min_overlap_squared,
            reference_px=address(self._reference_px, np.float64),
            jump_squared=address(self._jump_squared, np.float64),
            first=address(self._first, np.int32),
            other=address(self._other, np.int32),
            overlap_squared=address(self._overlap_squared, np.float32),
            position_px=address(self._position_px, np.float64),
            last_px=address(self._last_px, np.float64),
            found=address(self._found, np.bool_),
            kept=address(self._kept, np.bool_),
        )
        self._byref = ctypes.byref(self._fields)
        self._check = kernel("labels_check", POINTER)

    def check(self, position_px: Array, found: Mask, last_px: Array) -> tuple[int, bool]:
        """Clear `found` (n,) of beads that share a place with another found one, whose step from last_px to
        position_px (n, 2) is shorter.

        Return the number of beads that are not found, and whether a found one moved by more than its limit.
        """
        np.copyto(self._position_px, position_px)
        np.copyto(self._last_px, last_px)
        np.copyto(self._found, found)
        result = self._check(self._byref)
        np.copyto(found, self._kept)
        return result >> 1, bool(result & 1)
