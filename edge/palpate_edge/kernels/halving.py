"""Colour images at half the resolution, and one channel of them, in memory that is reused."""

from __future__ import annotations

import ctypes
from ctypes import c_float, c_int32, c_int64

import numpy as np

from palpate_edge.common.arrays import Floats, Image
from palpate_edge.kernels.library import POINTER, address, kernel

_HALVE = (POINTER, c_int64, c_int32, c_int32, c_float, c_float, c_float, POINTER, POINTER)


class HalvedColours:
    """Halves images of one size after another.

    Memory of this size is returned to the system when it is freed, and each page of a new one costs a fault.
    """

    def __init__(self) -> None:
        self._halve = kernel("halve_colours", *_HALVE)
        self._allocate(0, 0)

    def read(self, image: Image, weights: tuple[float, float, float]) -> tuple[Image, Floats]:
        """Return the means of two by two pixels of an image (height, width, 3), and the sum of their colours
        B, G, R times the weights, both until the next call; an odd last row or column is left out."""
        height, width = image.shape[:2]
        if self._small.shape[:2] != (height // 2, width // 2):
            self._allocate(height // 2, width // 2)
        if image.strides[1:] != (3, 1) or image.dtype != np.uint8 or image.shape[2:] != (3,):
            raise TypeError(f"no colour image of bytes: {image.dtype} {image.shape}")
        at = ctypes.c_void_p(image.ctypes.data)
        self._halve(at, image.strides[0], height, width, *weights, *self._addresses)
        return self._small, self._plane

    def _allocate(self, height: int, width: int) -> None:
        self._small: Image = np.empty((height, width, 3), np.uint8)
        self._plane: Floats = np.empty((height, width), np.float32)
        self._addresses = address(self._small, np.uint8), address(self._plane, np.float32)
