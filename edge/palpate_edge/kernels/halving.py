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
        self._byref = ctypes.byref(self._struct)
        self._layout: tuple[object, ...] = ()
        self._allocate((0, 0))

    def begin(self, image: Image, weights: tuple[float, float, float] = NO_COLOUR) -> None:
        """Take an image (height, width, 3), and weights of B, G, R, or a grey one, until the next call.

        Raises TypeError for an image that is not of bytes, or whose pixels do not lie side by side.
        """
        layout = image.shape, image.strides, image.dtype, weights
        if layout != self._layout:
            self._lay_out(image, weights)
            self._layout = layout
        self._image = image
        self._struct.image = image.__array_interface__["data"][0]
        self._begin(self._byref)

    def complete(self) -> tuple[Image, Plane]:
        """Return the whole small image and its plane, until the next image."""
        self._complete(self._byref)
        return self.small, self.plane

    def _lay_out(self, image: Image, weights: tuple[float, float, float]) -> None:
        """Make room for images like this one."""
        is_coloured = image.ndim == COLOURS
        beside = (COLOURS, 1) if is_coloured else (1,)
        if image.strides[1:] != beside or image.dtype != np.uint8 or image.shape[2:] not in ((), (COLOURS,)):
            raise TypeError(f"no image of bytes: {image.dtype} {image.shape}")
        struct, (height, width) = self._struct, (side // 2 for side in image.shape[:2])
        shape = (height, width, COLOURS) if is_coloured else (height, width)
        if self.small.shape != shape:
            self._allocate(shape)
        struct.height, struct.width, struct.colours = height, width, COLOURS if is_coloured else 1
        struct.weights[:] = weights
        struct.stride = image.strides[0]

    def _allocate(self, shape: tuple[int, ...]) -> None:
        self.small: Image = np.zeros(shape, np.uint8)
        self.plane: Plane = np.zeros(shape[:2], np.float32) if len(shape) == COLOURS else self.small
        self._columns = np.zeros((4, shape[0]), np.int32)
        struct = self._struct
        struct.small = address(self.small, np.uint8)
        struct.plane = address(self.plane, self.plane.dtype.type)
        for name, columns in zip(("from", "to", "first", "last"), self._columns, strict=True):
            setattr(struct, name, address(columns, np.int32))
