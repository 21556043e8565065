"""Beads in windows near expected places; vision/window_search.py has the method and its numbers."""

from __future__ import annotations

import ctypes
from ctypes import c_double, c_float, c_int32
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.arrays import Array, Floats, Indices, Mask
from palpate_edge.kernels.centroids import CentroidFinder
from palpate_edge.kernels.library import POINTER, address, kernel
from palpate_edge.kernels.neighbourhood import NeighbourMeans


class SearchLimits(NamedTuple):
    """Numbers of window_search.py; steps in spacings, squared, and max_jumped in beads."""

    min_contrast_share: float
    min_predicted_share: float
    min_blob_share: float
    added_unevenness: float
    max_levelled_glare: float
    dim: float
    glare_noise: float
    glare_noise_per_unevenness: float
    max_noise: float
    max_step_squared: float
    max_predicted_squared: float
    max_blob_squared: float
    max_faint_squared: float
    max_jumped: float
    converged_step: float
    blob_step: float


class SearchedBeads(NamedTuple):
    """The reference's n beads: contrast, its least one, range of area, largest unevenness (n,), and in px^2
    spacing, jump, longest step of a window and distance within which windows show the same (n,)."""

    contrast: Array
    min_contrast: Array
    min_area: Array
    max_area: Array
    max_unevenness: Array
    spacing_squared: Array
    jump_squared: Array
    reach_squared: Array
    same_squared: Array


_SINGLES = 5  # of SearchedBeads are float32, the others float64
_FLOATS = 9  # of SearchLimits


class _Search(ctypes.Structure):
    _fields_ = (
        *((name, POINTER) for name in ("finder", "neighbours")),
        *((name, c_int32) for name in ("beads", "binning", "max_windows")),
        *((name, c_float) for name in SearchLimits._fields[:_FLOATS]),
        *((name, c_double) for name in SearchLimits._fields[_FLOATS:]),
        *((name, POINTER) for name in SearchedBeads._fields),
        *((name, POINTER) for name in ("expected_px", "predicted_px", "last_start_px", "position_px")),
        *((name, POINTER) for name in ("contrast_share", "area", "excess")),
        *((name, POINTER) for name in ("converged", "found", "levelled")),
        *((name, POINTER) for name in ("some", "sorted", "noise_unevenness", "noise", "windows")),
    )


class WindowSearchKernel:
    """Looks for the beads of one reference in the plane that the finder has.

    excess (n,): see window_search.py; windows (n,): that were measured of each bead since the start.
    """

    def __init__(
        self,
        finder: CentroidFinder,
        means: NeighbourMeans,
        beads: SearchedBeads,
        limits: SearchLimits,
        *,
        binning: int,
        max_windows: int,
    ) -> None:
        """finder, means: of the same n beads; binning: pixels, along an axis, of one of the finder's;
        max_windows: of one bead in one search."""
        count = len(beads.contrast)
        self._expected_px, self._predicted_px = np.zeros((2, count, 2))
        self._position_px, last_start_px = np.zeros((2, count, 2))
        self._contrast_share, self._area, self.excess, self._noise = np.zeros((4, count), np.float32)
        self._converged, self._found, levelled = np.zeros((3, count), np.bool_)
        self._some, self.windows = np.zeros((2, count), np.int64)
        self._unevenness = np.zeros(1, np.float32)
        self._arrays: tuple[
            NDArray[Any], ...
        ] = (  # in the order of the structure; kept as long as the kernel is used
            *(np.ascontiguousarray(array, np.float32) for array in beads[:_SINGLES]),
            *(np.ascontiguousarray(array, np.float64) for array in beads[_SINGLES:]),
            *(self._expected_px, self._predicted_px, last_start_px, self._position_px),
            *(self._contrast_share, self._area, self.excess, self._converged, self._found, levelled),
            *(self._some, np.zeros(count, np.float32), self._unevenness, self._noise, self.windows),
        )
        self._parts = finder, means
        struct = _Search(
            ctypes.addressof(finder.struct),
            ctypes.addressof(means.struct),
            count,
            binning,
            max_windows,
            *limits,
            *(address(array, array.dtype.type) for array in self._arrays),
        )
        self._struct = ctypes.byref(struct)
        self._beads = kernel("window_search_beads", POINTER, c_int32, c_int32)
        self._missing = kernel("window_search_missing", POINTER, c_float)
        self._matched = kernel("window_search_matched", POINTER, c_int32, c_int32, c_float)
        self._noises = kernel("window_search_noise", POINTER)

    def find_beads(
        self, expected_px: Array, max_faint: int, max_faint_after_jump: int
    ) -> tuple[Array, Mask] | None:
        """Return places (n, 2) of all beads near `expected_px` (n, 2), and which (n,) were found; None where
        too many first windows are faint."""
        np.copyto(self._expected_px, expected_px)
        if not self._beads(self._struct, max_faint, max_faint_after_jump):
            return None
        return self._position_px.copy(), self._found.copy()

    def find_missing(self, max_glare: float) -> tuple[Array, Mask]:
        """Return places (n, 2) and flags (n,) of find_beads, with those that are where the others predict
        them."""
        self._missing(self._struct, max_glare)
        return self._position_px.copy(), self._found.copy()

    def find_matched(
        self, blob_px: Array, beads: Indices, predicted_px: Array, max_windows: int, max_glare: float
    ) -> tuple[Array, Mask]:
        """Return places (m, 2) of `beads` (m,) at `blob_px` (m, 2), not far from `predicted_px` (m, 2), and
        which (m,) were found. Raises IndexError for a number that is that of no bead."""
        count = len(beads)
        np.copyto(self._some[:count], beads)
        np.copyto(self._expected_px[:count], blob_px)
        np.copyto(self._predicted_px[:count], predicted_px)
        if self._matched(self._struct, count, max_windows, max_glare) < 0:
            raise IndexError(f"beads {beads.tolist()} are not all of {len(self._some)}")
        return self._position_px[beads], self._found[beads]

    def noise(self, found: Mask) -> Floats | None:
        """Return the noise (n,) of the beads, 1 of those not `found` (n,); None where all are exact."""
        np.copyto(self._found, found)
        return self._noise.copy() if self._noises(self._struct) else None
