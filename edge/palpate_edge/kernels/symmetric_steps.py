"""Steps to the centres of symmetry of beads; vision/symmetric_fit.py has the method."""

from __future__ import annotations

import ctypes
from ctypes import c_float, c_int32
from typing import NamedTuple

import numpy as np

from palpate_edge.common.arrays import Array, Floats, Image, Indices, Mask
from palpate_edge.kernels.chosen_beads import ChosenBeads
from palpate_edge.kernels.halving import HalvedImage
from palpate_edge.kernels.library import POINTER, address, kernel

COLUMNS = 24  # of a row of the least squares; the kernel reads the unused ones as 0
MOST_SAMPLES, COLOURS = 256, 3
LEAST_SIDE_PX = 2  # of an image


class SymmetricMatrices(NamedTuple):
    """Constants of the fit of n beads in k kinds with g samples and p profiles.

    grid (g, 2), bead diameters; diameter_px (n,); weights (c, 3) of B, G, R for each channel; kind (n,);
    own (k, g): 1 for samples that are a bead's own, else 0; rows (k, g, 4 p + 3): see
    symmetric_fit.py; per_freedom (n,); motion_gram (n, 3, p p).
    """

    grid: Array
    diameter_px: Array
    weights: Floats
    kind: Indices
    own: Mask
    rows: Array
    per_freedom: Array
    motion_gram: Array


class SymmetricLimits(NamedTuple):
    """Numbers of symmetric_fit.py, by their names there; steps in bead diameters, greys in grey levels."""

    rounds: int
    noise: float
    least_variation: float
    clipped_grey: float
    clipped_sigma: float
    clipped_share: float
    max_step: float
    far_step: float


class Centres(NamedTuple):
    """position_px (m, 2) in the image that was read; sigma (m,), bead diameters; explained, clipped (m,)."""

    position_px: Array
    sigma: Array
    explained: Floats
    clipped: Floats


class _Image(ctypes.Structure):
    _fields_ = (
        *((name, POINTER) for name in ("source", "pixels")),
        *((name, c_int32) for name in ("height", "width", "colours")),
    )


class _Fit(ctypes.Structure):
    _fields_ = (
        ("image", _Image),
        *((name, c_int32) for name in ("samples", "padded_samples", "channels", "rounds")),
        *((name, c_float) for name in (*SymmetricLimits._fields[1:], "reach")),
        *((name, POINTER) for name in SymmetricMatrices._fields),
        *((name, POINTER) for name in ("which", *Centres._fields)),
    )


class SymmetricSteps:
    """Moves places to the centres of symmetry of beads in an image."""

    def __init__(self, matrices: SymmetricMatrices, limits: SymmetricLimits) -> None:
        """Raises ValueError where the kernel has no room for so many samples or columns."""
        kinds, samples, columns = matrices.rows.shape
        padded = -(-samples // 4) * 4
        count, self._channels = len(matrices.diameter_px), len(matrices.weights)
        if padded > MOST_SAMPLES or columns > COLUMNS or self._channels > COLOURS:
            raise ValueError(f"no room for {samples} samples, {columns} columns, {self._channels} channels")
        grid, own = np.zeros((2, padded), np.float32), np.zeros((kinds, padded), np.float32)
        rows = np.zeros((kinds, padded, COLUMNS), np.float32)
        grid[:, :samples] = matrices.grid.T
        own[:, :samples] = matrices.own
        rows[:, :samples, :columns] = matrices.rows
        self._chosen = ChosenBeads(count)
        self._centres = Centres(np.zeros((count, 2)), np.zeros(count), *np.zeros((2, count), np.float32))
        self._arrays = (  # in the order of the structure; kept as long as the fit is used
            grid,
            np.asarray(matrices.diameter_px, np.float32),
            np.ascontiguousarray(matrices.weights, np.float32),
            np.asarray(matrices.kind, np.int32),
            own,
            rows,
            np.asarray(matrices.per_freedom, np.float32),
            np.ascontiguousarray(matrices.motion_gram, np.float32),
            self._chosen.which,
            *self._centres,
        )
        addresses = (address(array, array.dtype.type) for array in self._arrays)
        reach = float(np.abs(grid).max())
        self.struct = _Fit(_Image(), samples, padded, self._channels, *limits, reach, *addresses)
        self._fit = ctypes.byref(self.struct)
        self._measure = kernel("symmetric_fit_measure", POINTER, c_int32)
        self._source: HalvedImage | None = None
        self.load(np.zeros((LEAST_SIDE_PX, LEAST_SIDE_PX, COLOURS), np.uint8))

    def load(self, image: Image) -> None:
        """Take the image (height, width, 3) or (height, width) that is measured until the next one is loaded.

        Raises ValueError for one that is smaller than two by two pixels, or of too few colours.
        """
        height, width = image.shape[:2]
        colours = 1 if image.ndim == 2 else image.shape[2]
        if min(height, width) < LEAST_SIDE_PX:
            raise ValueError(f"an image of {width} x {height} pixels shows no bead")
        if colours != COLOURS and (colours, self._channels) != (1, 1):
            raise ValueError(f"an image of {colours} colours has no {self._channels} channels")
        self._image, self._source = np.ascontiguousarray(image), None
        self.struct.image = _Image(None, address(self._image, np.uint8), height, width, colours)

    def load_halved(self, image: HalvedImage) -> None:
        """Take an image at half the resolution, whose pixels are made as they are read."""
        if self._source is image and self._image is image.small:
            return
        self.load(image.small)
        self._source = image
        self.struct.image.source = image.address

    def measure(self, start_px: Array, beads: Indices | None) -> Centres:
        """Return the centres near `start_px` (m, 2), in the image's pixels, of `beads` (m,), all if None.

        Raises ValueError for beads that the layout does not have, or places of another number of beads.
        """
        count = self._chosen.choose(beads, start_px)
        self._centres.position_px[:count] = start_px
        self._measure(self._fit, count)
        position_px, sigma, explained, clipped = self._centres
        return Centres(
            position_px[:count].copy(), sigma[:count].copy(), explained[:count].copy(), clipped[:count].copy()
        )
