"""Binning: images at half the resolution, each pixel the mean of two by two."""

from __future__ import annotations

from typing import cast

import cv2
import numpy as np

from palpate_edge.common.arrays import Floats, Image, Plane


def halved(image: Plane) -> Plane:
    """Return the image (height, width, ...) at half the resolution; an odd last row or column is left out."""
    height, width = image.shape[0] // 2, image.shape[1] // 2
    whole = image[: 2 * height, : 2 * width]
    return cast(Plane, cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA))


class HalvedPixels:
    """Colour images at half the resolution in single precision, in memory that is reused.

    Memory of this size is returned to the system when it is freed, and each page of a new one costs a fault.
    """

    def __init__(self) -> None:
        self._small: Image = np.empty((0, 0, 3), np.uint8)
        self._pixels: Floats = np.empty((0, 0, 3), np.float32)

    def read(self, image: Image) -> Floats:
        """Return what :func:`halved` does of an image (height, width, 3), until the next call."""
        height, width = image.shape[0] // 2, image.shape[1] // 2
        if self._small.shape[:2] != (height, width):
            self._small = np.empty((height, width, 3), np.uint8)
            self._pixels = np.empty((height, width, 3), np.float32)
        whole = image[: 2 * height, : 2 * width]
        cv2.resize(whole, (width, height), dst=self._small, interpolation=cv2.INTER_AREA)
        np.copyto(self._pixels, self._small)
        return self._pixels
