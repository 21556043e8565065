"""Patches: the pixels about many places of an image, read at once into memory that is reused."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from palpate_edge.common.arrays import Array, Floats, Indices, Mask, Plane

SKIN_RADIUS, SKIN_PIXELS = 0.8, 16  # circle on the skin about a bead: radius in bead diameters, pixels
CORE_RADIUS, CORE_PIXELS = 0.25, 16  # circle inside the bead
FAST_ITEM_WIDTH = 16  # bytes: NumPy copies items of this size much faster than of one byte less


class Patches:
    """A binned plane with a border of repeated pixels, and its pixels about many centres.

    steps (w, 2): offsets (column, row) from a centre to the pixels of its square; circle_steps (n, 32, 2):
    offsets to the pixels of the circles on the skin and in the core of each bead.
    """

    def __init__(self, binning: int, reach: int, diameter: Array) -> None:
        """reach: half the side of the squares; diameter (n,): of the beads; both in binned pixels."""
        self._binning = binning
        self._side = 2 * reach + 1
        self._width = max(self._side, FAST_ITEM_WIDTH)
        row, column = np.mgrid[: self._side, : self._width] - reach
        self.steps = np.stack([column.ravel(), row.ravel()], axis=1)
        circles = (_circle(SKIN_RADIUS * diameter, SKIN_PIXELS), _circle(CORE_RADIUS * diameter, CORE_PIXELS))
        self.circle_steps = np.concatenate(circles, axis=1)
        self._border = max(self._width, int(np.abs(self.circle_steps).max())) + 1
        self._shape = 0, 0

    def load(self, dark: Plane, *, binned: bool = False) -> None:
        """Take a plane, `binned` already or not; planes of the same shape and type reuse the memory."""
        binning = 1 if binned else self._binning
        shape = dark.shape[0] // binning, dark.shape[1] // binning
        if shape != self._shape or dark.dtype != self._bordered.dtype:
            self._allocate(shape, dark.dtype)
        height, width = shape
        whole = dark[: height * binning, : width * binning]
        if binning == 1:
            np.copyto(self._inner, whole)
        else:
            cv2.resize(whole, (width, height), dst=self._inner, interpolation=cv2.INTER_AREA)
        self._border_filled = False

    def _allocate(self, shape: tuple[int, int], dtype: np.dtype[Any]) -> None:
        self._shape, border = shape, self._border
        height, width = shape
        self._bordered = np.zeros((height + 2 * border, width + 2 * border), dtype)
        self._inner = self._bordered[border:-border, border:-border]
        self._high = np.array([width - 1.0, height - 1.0])
        self._middle = self._high / 2
        self._clear = self._middle - border  # from the middle: no patch reaches beyond the image
        self._stride = self._bordered.shape[1]
        first = border * self._stride + border  # index of the image's first pixel
        self._flat = self._bordered.ravel()
        self._circle_indices = self.circle_steps[..., 1] * self._stride + self.circle_steps[..., 0] + first
        corner = int(first + self.steps[0, 1] * self._stride + self.steps[0, 0])
        bytes_ = self._bordered.itemsize
        self._squares = np.ndarray(  # the rows of each square, one row an item
            (height * self._stride, self._side),
            np.dtype((np.void, self._width * bytes_)),
            self._bordered.data,
            corner * bytes_,
            (bytes_, self._stride * bytes_),
        )

    def inside(self, position: Array) -> Array:
        """Return the nearest positions (m, 2) inside the image; the same array if no patch leaves it."""
        if (np.abs(position - self._middle) < self._clear).all():
            return position
        if not self._border_filled:
            self._fill_border()
        return np.asarray(np.minimum(np.maximum(position, 0.0), self._high))

    def _fill_border(self) -> None:
        border, pixels = self._border, self._bordered
        pixels[:border, border:-border] = self._inner[0]
        pixels[-border:, border:-border] = self._inner[-1]
        pixels[:, :border] = pixels[:, border, None]
        pixels[:, -border:] = pixels[:, -border - 1, None]
        self._border_filled = True

    def outside(self, position: Array) -> Mask:
        """Return which positions (m, 2) lie outside the image, (m,)."""
        return np.asarray(((position < 0) | (position > self._high)).any(axis=1))

    def index(self, centre: Indices) -> Indices:
        """Return the indices (m,) in memory of the pixels `centre` (m, 2), relative to the first pixel."""
        return np.asarray(centre[:, 1] * self._stride + centre[:, 0])

    def circles(self, index: Indices, beads: slice | Indices) -> Floats:
        """Return the greys (m, 32) on the circles of the `beads` whose centres have these indices (m,)."""
        greys: Plane = self._flat.take(index[:, None] + self._circle_indices[beads])
        return greys.astype(np.float32)

    def squares(self, index: Indices) -> Floats:
        """Return the greys (m, w) of the squares about the centres (m,), in the order of `steps`."""
        rows = self._squares[index]
        return rows.view(self._bordered.dtype).reshape(len(index), -1).astype(np.float32)


def _circle(radius: Array, count: int) -> Indices:
    """Return the offsets (n, count, 2) of `count` pixels on circles of `radius` (n,)."""
    angle = 2 * np.pi * np.arange(count) / count
    offsets = radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.asarray(np.rint(offsets), dtype=np.intp)
