"""Images at half the resolution, of which only the parts are made that kernels read."""

from __future__ import annotations

import ctypes
from ctypes import c_float, c_int32, c_int64

import numpy as np

from palpate_edge.common.arrays import Image, Plane
from palpate_edge.kernels.library import POINTER, address, kernel

COLOURS = 3
NO_COLOUR = (0.0, 0.0, 0.0)


class _Halving(ctypes.Structure):
    _fields_ = (
        *((name, c_int32) for name in ("height", "width", "colours")),
        ("weights", c_float * COLOURS),
        ("stride", c_int64),
        *((name, POINTER) for name in ("image", "small", "plane", "from", "to", "first", "last")),
    )


class HalvedImage:
    """Halves images of one size after another, an odd last row or column left out.

    small (height / 2, width / 2, 3) or grey: means of two by two pixels; plane (height / 2, width / 2): the
    grey image, or the sum of the colours B, G, R times weights. Both are complete only after `complete`;
    until then a kernel that is given `address` makes what it reads. The memory is reused: memory of this size
    is returned to the system when it is freed, and each page of a new one costs a fault.
    """

    def __init__(self) -> None:
        self._struct = _Halving()
        self.address = ctypes.addressof(self._struct)
        self._begin, self._complete = (kernel(f"halving_{name}", POINTER) for name in ("begin", "complete"))
        self._allocate(0, 0, 1)

    def begin(self, image: Image, weights: tuple[float, float, float] = NO_COLOUR) -> None:
        """Take an image (height, width, 3), and weights of B, G, R, or a grey one, until the next call.

        Raises TypeError for an image that is not of bytes, or whose pixels do not lie side by side.
        """
        height, width = image.shape[0] // 2, image.shape[1] // 2
        colours = image.shape[2] if image.ndim == COLOURS else 1
        beside = (COLOURS, 1) if image.ndim == COLOURS else (1,)
        if image.strides[1:] != beside or image.dtype != np.uint8 or colours not in (1, COLOURS):
            raise TypeError(f"no image of bytes: {image.dtype} {image.shape}")
        struct = self._struct
        if (struct.height, struct.width, struct.colours) != (height, width, colours):
            self._allocate(height, width, colours)
        self._image = image
        struct.weights[:] = weights
        struct.stride, struct.image = image.strides[0], image.ctypes.data
        self._begin(self.address)

    def complete(self) -> tuple[Image, Plane]:
        """Return the whole small image and its plane, until the next image."""
        self._complete(self.address)
        return self.small, self.plane

    def _allocate(self, height: int, width: int, colours: int) -> None:
        shape = (height, width) if colours == 1 else (height, width, colours)
        self.small: Image = np.empty(shape, np.uint8)
        self.plane: Plane = self.small if colours == 1 else np.empty((height, width), np.float32)
        self._columns = np.zeros((4, height), np.int32)
        struct = self._struct
        struct.height, struct.width, struct.colours = height, width, colours
        struct.small = address(self.small, np.uint8)
        struct.plane = address(self.plane, self.plane.dtype.type)
        for name, columns in zip(("from", "to", "first", "last"), self._columns, strict=True):
            setattr(struct, name, address(columns, np.int32))
