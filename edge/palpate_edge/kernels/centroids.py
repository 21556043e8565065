"""Weighted centroids of beads, each in a small window; vision/subpixel.py has the method."""

from __future__ import annotations

import ctypes
from ctypes import c_double, c_float, c_int32
from typing import NamedTuple

import numpy as np

from palpate_edge.common.arrays import Array, Counts, Floats, Indices, Mask, Plane
from palpate_edge.kernels.chosen_beads import ChosenBeads
from palpate_edge.kernels.halving import HalvedImage
from palpate_edge.kernels.library import POINTER, address, kernel

AT_ONCE = 8  # pixels of a row that the kernel weights together
OUTSIDE = -1e6  # added to the weight of pixels outside a window


class WindowShapes(NamedTuple):
    """Windows about n beads, in binned pixels.

    reach: half the side of the windows; circles (n, 32, 2): steps (column, row) from the centre to pixels of
    the skin (16) and of the bead (16); ranks (2, 16): weights of the skin's sorted greys in its grey and in
    its variation; added (n or 1, side, side): to the pixels' weights; slope (n, 2): of the skin's grey over
    the contrast; slope_shift (n, 2): of the centroid by the slope; half_area (n,); max_unevenness (n,): from
    more on the skin's slope in the frame is subtracted; diameter (n,).
    """

    reach: int
    circles: Indices
    ranks: Floats
    added: Array
    slope: Array
    slope_shift: Array
    half_area: Array
    max_unevenness: Array
    diameter: Array


class WindowLimits(NamedTuple):
    """Numbers of subpixel.py; unlit: grey where no light falls, None where the slope is a part of `added`;
    max_step: bead diameters."""

    gate: float
    unlit: float | None
    darkest_skin: float
    max_step: float


class Found(NamedTuple):
    """Centroids of m beads: place (m, 2), binned pixels; contrast, area, unevenness (m,); converged (m,);
    windows (m,): that were measured; levelled (m,): the slope of the skin's grey was subtracted."""

    place: Array
    contrast: Floats
    area: Floats
    unevenness: Floats
    converged: Mask
    windows: Counts
    levelled: Mask


class _Plane(ctypes.Structure):
    _fields_ = (
        *((name, POINTER) for name in ("source", "pixels")),
        *((name, c_int32) for name in ("is_bytes", "height", "width")),
    )


class _Finder(ctypes.Structure):
    _fields_ = (
        ("plane", _Plane),
        *((name, c_int32) for name in ("side", "reach", "stride", "per_bead", "is_shaded", "pixels_reach")),
        *((name, c_float) for name in ("gate", "unlit", "darkest_skin")),
        ("max_step", c_double),
        *((name, POINTER) for name in (*WindowShapes._fields[1:], "window")),
        *((name, POINTER) for name in ("which", "start", "min_contrast", *Found._fields)),
    )


class CentroidFinder:
    """Finds the centroids of one layout's beads in a stream of planes.

    struct: the finder for other kernels, as long as this object is kept.
    """

    def __init__(self, shapes: WindowShapes, limits: WindowLimits) -> None:
        count, side = len(shapes.diameter), 2 * shapes.reach + 1
        stride = -(-side // AT_ONCE) * AT_ONCE
        added = np.full((len(shapes.added), side, stride), OUTSIDE)
        added[:, :, :side] = shapes.added.reshape(-1, side, side)
        given = shapes._replace(added=added)[1:]
        types = (np.int32, np.float32, np.float32, np.float32, np.float64, np.float32, np.float32, np.float64)
        self._chosen, self._start = ChosenBeads(count), np.zeros((count, 2))
        self._min_contrast, *floats = np.zeros((4, count), np.float32)
        flags, windows = np.zeros((2, count), np.bool_), np.zeros(count, np.int32)
        self._found = Found(
            np.zeros((count, 2)), floats[0], floats[1], floats[2], flags[0], windows, flags[1]
        )
        self._arrays = (  # in the order of the structure; kept as long as the finder is used
            *(np.ascontiguousarray(array, kind) for array, kind in zip(given, types, strict=True)),
            np.zeros((side, stride), np.float32),
            self._chosen.which,
            self._start,
            self._min_contrast,
            *self._found,
        )
        addresses = (address(array, array.dtype.type) for array in self._arrays)
        per_bead, is_shaded = len(shapes.added) > 1, limits.unlit is not None
        numbers = limits.gate, limits.unlit or 0.0, limits.darkest_skin, limits.max_step
        pixels_reach = max(shapes.reach, int(np.abs(shapes.circles).max()))
        self.struct = _Finder(
            _Plane(), side, shapes.reach, stride, per_bead, is_shaded, pixels_reach, *numbers, *addresses
        )
        self._finder = ctypes.byref(self.struct)
        self._find = kernel("find_centroids", POINTER, *[c_int32] * 3, c_double)
        self._source: HalvedImage | None = None
        self.load(np.zeros((1, 1), np.float32))

    def load(self, plane: Plane) -> None:
        """Take the plane (height, width) in which :meth:`find` measures until the next one is loaded.

        Raises ValueError for one without pixels.
        """
        if not plane.size or plane.ndim != 2:
            raise ValueError(f"a plane of shape {plane.shape} shows no bead")
        is_bytes = plane.dtype == np.uint8
        self._plane, self._source = np.ascontiguousarray(plane, np.uint8 if is_bytes else np.float32), None
        pixels = address(self._plane, self._plane.dtype.type)
        self.struct.plane = _Plane(None, pixels, is_bytes, *plane.shape)

    def load_halved(self, image: HalvedImage) -> None:
        """Take the plane of an image at half the resolution, whose pixels are made as they are read.

        Raises ValueError for one without pixels.
        """
        if self._source is image and self._plane is image.plane:
            return
        if not image.plane.size:
            raise ValueError(f"a plane of shape {image.plane.shape} shows no bead")
        self._plane, self._source = image.plane, image
        pixels = address(self._plane, self._plane.dtype.type)
        is_bytes = self._plane.dtype == np.uint8
        self.struct.plane = _Plane(image.address, pixels, is_bytes, *self._plane.shape)

    def find(
        self,
        start: Array,
        beads: Indices | None,
        max_steps: int,
        min_contrast: Floats | float,
        max_faint: int | None,
        converged_step: float,
    ) -> Found:
        """Return the centroids of `beads` (m,), all if None, about `start` (m, 2), binned pixels.

        Where more than `max_faint` starts show less than min_contrast, one or (m,), all stay where they are.
        Raises ValueError for beads that the layout does not have, or places of another number of beads.
        """
        count = self._chosen.choose(beads, start)
        self._start[:count] = start
        self._min_contrast[:count] = min_contrast
        limit = count if max_faint is None else max_faint
        self._find(self._finder, count, max_steps, limit, converged_step)
        return Found(*[values[:count].copy() for values in self._found])  # type: ignore[arg-type]
