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
        ("peak", POINTER),
        ("position_px", POINTER),
        ("strength", POINTER),
    )


class BlobPeaks:
    """Finds peaks in planes; memory is made once for planes of the same shape.

    The determinant is of Sobel's second derivatives; it is not positive where the plane is bent down along x.
    A peak is above the limit and as high as all pixels within reach.
    """

    def __init__(self, most: int | None) -> None:
        """most: at most so many peaks are kept, the strongest; None: all."""
        self._most = most
        self._plane: Floats = np.empty((0, 0), np.float32)
        self._fields = PeaksFields()
        self._byref = ctypes.byref(self._fields)
        self._find = kernel("blob_peaks_find", POINTER)

    def plane(self, shape: tuple[int, int]) -> Floats:
        """Return the plane (height, width) that :meth:`find` reads, to be filled."""
        if self._plane.shape != shape:
            self._allocate(*shape)
        return self._plane

    def _allocate(self, height: int, width: int) -> None:
        shape = height, width
        most = height * width if self._most is None else min(self._most, height * width)
        self._plane, self._determinant = np.empty(shape, np.float32), np.empty(shape, np.float32)
        self._sums = np.empty((3, width + 2), np.float32)
        self._peak, self._position_px, self._strength = (
            np.empty(most, PEAK),
            np.empty((most, 2)),
            np.empty(most),
        )
        fields = self._fields
        fields.height, fields.width, fields.most = height, width, most
        fields.plane, fields.determinant, fields.sums = (
            address(array, np.float32) for array in (self._plane, self._determinant, self._sums)
        )
        fields.peak = self._peak.ctypes.data
        fields.position_px, fields.strength = (
            address(array, np.float64) for array in (self._position_px, self._strength)
        )

    def find(self, reach: int, limit: float, gain: float, pixel_px: int) -> tuple[Array, Array]:
        """Return the places (n, 2) of the plane's peaks in the whole image, and their strengths (n,), the
        strongest first.

        reach: pixels within which a peak is the highest, at least 1; limit: of the determinant; gain: of the
        strength over the determinant's root; pixel_px: side of the plane's pixels in the whole image.
        """
        if min(self._plane.shape) < MIN_SIDE or not len(self._peak):
            return np.empty((0, 2)), np.empty(0)
        fields = self._fields
        fields.reach, fields.limit, fields.gain, fields.pixel_px = reach, limit, gain, pixel_px
        count = self._find(self._byref)
        return self._position_px[:count].copy(), self._strength[:count].copy()
