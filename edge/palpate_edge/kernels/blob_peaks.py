"""Blob peaks: where the determinant of a plane's second derivatives is highest, strongest first."""

from __future__ import annotations

import ctypes

import numpy as np

from palpate_edge.common.arrays import Array, Floats
from palpate_edge.kernels.library import POINTER, address, kernel

MIN_SIDE = 3  # pixels; the pixels of the edge are no peaks
PEAK = np.dtype([("root", np.float32), ("pixel", np.int32)])


class PeaksFields(ctypes.Structure):
    """Mirror of `struct blob_peaks`."""

    _fields_ = (
        ("height", ctypes.c_int32),
        ("width", ctypes.c_int32),
        ("reach", ctypes.c_int32),
        ("most", ctypes.c_int32),
        ("limit", ctypes.c_float),
        ("gain", ctypes.c_double),
        ("pixel_px", ctypes.c_double),
        ("plane", POINTER),
        ("determinant", POINTER),
        ("sums", POINTER),
        ("highest", POINTER),
        ("around", POINTER),
        ("peak", POINTER),
        ("position_px", POINTER),
        ("strength", POINTER),
    )


class BlobPeaks:
    """Finds peaks in planes; memory is made once for planes of the same shape.

    The determinant is of Sobel's second derivatives, 0 where the plane is bent down along x. A peak is above the
    limit and as high as all pixels within reach.
    """

    def __init__(self, most: int | None) -> None:
        """most: at most so many peaks are kept, the strongest; None: all."""
        self._most, self._reach = most, 0
        self._plane: Floats = np.empty((0, 0), np.float32)
        self._fields = PeaksFields()
        self._byref = ctypes.byref(self._fields)
        self._find = kernel("blob_peaks_find", POINTER)

    def plane(self, shape: tuple[int, int], reach: int) -> Floats:
        """Return the plane (height, width) that :meth:`find` reads, to be filled.

        reach: pixels, at least 1, within which a peak is the highest.
        """
        if self._plane.shape != shape or self._reach != reach:
            self._allocate(shape, reach)
        return self._plane

    def _allocate(self, shape: tuple[int, int], reach: int) -> None:
        (height, width), self._reach = shape, reach
        most = height * width if self._most is None else min(self._most, height * width)
        self._plane, self._determinant = np.empty(shape, np.float32), np.empty(shape, np.float32)
        self._sums, self._around = np.empty((3, width + 2), np.float32), np.empty(width, np.float32)
        self._highest = np.full(width + 2 * reach, -np.inf, np.float32)
        self._peak, self._position_px, self._strength = np.empty(most, PEAK), np.empty((most, 2)), np.empty(most)
        fields = self._fields
        fields.height, fields.width, fields.reach, fields.most = height, width, reach, most
        fields.plane, fields.determinant = (
            address(array, np.float32) for array in (self._plane, self._determinant)
        )
        fields.sums, fields.highest, fields.around = (
            address(array, np.float32) for array in (self._sums, self._highest, self._around)
        )
        fields.peak = self._peak.ctypes.data
        fields.position_px, fields.strength = (
            address(array, np.float64) for array in (self._position_px, self._strength)
        )

    def find(self, limit: float, gain: float, pixel_px: int) -> tuple[Array, Array]:
        """Return the places (n, 2) of the plane's peaks in the whole image, and their strengths (n,), the
        strongest first.

        limit: of the determinant; gain: strength over the determinant's root; pixel_px: side of the plane's
        pixels in the whole image.
        """
        if min(self._plane.shape) < MIN_SIDE or not len(self._peak):
            return np.empty((0, 2)), np.empty(0)
        fields = self._fields
        fields.limit, fields.gain, fields.pixel_px = limit, gain, pixel_px
        count = self._find(self._byref)
        return self._position_px[:count].copy(), self._strength[:count].copy()
