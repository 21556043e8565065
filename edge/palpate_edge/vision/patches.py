"""The pixels about many places of an image at once, read with few calls and into memory that is kept."""

from __future__ import annotations

import cv2
import numpy as np

from palpate_edge.common.arrays import Array, Floats, Indices, Mask, Plane

SKIN_RADIUS, SKIN_PIXELS = 0.8, 16  # the circle that tells the skin's grey, in bead diameters
CORE_RADIUS, CORE_PIXELS = 0.25, 16  # the circle that tells the bead's
SWIFT_WIDTH = 16  # bytes: numpy copies items of this size much faster than of one less


class Patches:
    """A plane, binned, with its outermost pixels repeated outwards, and its pixels about many centres.

    steps (w, 2): from a centre to the pixels of its square, columns first; circle_steps (n, 32, 2): to those
    of the circles on the skin and in the core of each bead.
    """

    def __init__(self, binning: int, reach: int, diameter: Array) -> None:
        """reach: of the squares about a centre; diameter (n,) of the beads; in binned pixels."""
        self._binning = binning
        self._side = 2 * reach + 1
        self._width = max(self._side, SWIFT_WIDTH)
        row, column = np.mgrid[: self._side, : self._width] - reach
        self.steps = np.stack([column.ravel(), row.ravel()], axis=1)
        circles = (_circle(SKIN_RADIUS * diameter, SKIN_PIXELS), _circle(CORE_RADIUS * diameter, CORE_PIXELS))
        self.circle_steps = np.concatenate(circles, axis=1)
        self._border = max(self._width, int(np.abs(self.circle_steps).max())) + 1
        self._shape: tuple[int, ...] = ()

    def load(self, dark: Plane) -> None:
        """Take a plane; memory is kept from plane to plane of one shape."""
        if dark.shape != self._shape or dark.dtype != self._bordered.dtype:
            self._allocate(dark)
        height, width = self._inner.shape
        whole = dark[: height * self._binning, : width * self._binning]
        if self._binning == 1:
            np.copyto(self._inner, whole)
        else:
            cv2.resize(whole, (width, height), dst=self._inner, interpolation=cv2.INTER_AREA)
        self._border_filled = False

    def _allocate(self, dark: Plane) -> None:
        self._shape, border = dark.shape, self._border
        height, width = (size // self._binning for size in dark.shape)
        self._bordered = np.zeros((height + 2 * border, width + 2 * border), dark.dtype)
        self._inner = self._bordered[border:-border, border:-border]
        self._high = np.array([width - 1.0, height - 1.0])
        self._middle = self._high / 2
        self._clear = self._middle - border  # from there: no window reaches beyond the image
        self._stride = self._bordered.shape[1]
        first = border * self._stride + border  # where the image's first pixel lies
        self._flat = self._bordered.ravel()
        self._circle_places = self.circle_steps[..., 1] * self._stride + self.circle_steps[..., 0] + first
        corner = int(first + self.steps[0, 1] * self._stride + self.steps[0, 0])
        bytes_ = self._bordered.itemsize
        self._squares = np.ndarray(  # of each place the rows of its square, a row one item
            (height * self._stride, self._side),
            np.dtype((np.void, self._width * bytes_)),
            self._bordered.data,
            corner * bytes_,
            (bytes_, self._stride * bytes_),
        )

    def inside(self, position: Array) -> Array:
        """The nearest positions (m, 2) inside the image; the same array where no window leaves the image."""
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
        """(m,): positions that do not lie in the image."""
        return np.asarray(((position < 0) | (position > self._high)).any(axis=1))

    def place(self, centre: Indices) -> Indices:
        """Where the pixels `centre` (m, 2) lie in memory, (m,)."""
        return np.asarray(centre[:, 1] * self._stride + centre[:, 0])

    def circles(self, place: Indices, beads: slice | Indices) -> Floats:
        """Greys (m, 32) on the circles of each of the beads about its place (m,)."""
        greys: Plane = self._flat.take(place[:, None] + self._circle_places[beads])
        return greys.astype(np.float32)

    def squares(self, place: Indices) -> Floats:
        """Greys (m, w) of the squares about each place (m,), in the order of `steps`."""
        rows = self._squares[place]
        return rows.view(self._bordered.dtype).reshape(len(place), -1).astype(np.float32)


def _circle(radius: Array, count: int) -> Indices:
    """Offsets (n, count, 2) of `count` pixels on a circle of each bead's `radius` (n,)."""
    angle = 2 * np.pi * np.arange(count) / count
    offsets = radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.asarray(np.rint(offsets), dtype=np.intp)
