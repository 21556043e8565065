"""Marker density: how many markers there are about each point of a grid, whichever markers they are.

It needs no marker's number, changes smoothly with the skin's deformation, and predicts where each marker is
to be searched (pairing.py).
"""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array, Floats
from palpate_edge.geometry.points import spacing

STEP = 1.0  # of the grid, in marker spacings
SIGMA = 0.8  # of the Gaussian that each marker adds, in marker spacings
MARGIN = 1.5  # of the grid about the markers at rest, in marker spacings
FARTHEST = (
    40.0  # limit of the exponent: products of smaller numbers are denormal, which takes ten times as long
)
MOST_STEPS = 40  # of the grid in each direction


class MarkerDensity:
    """The grid over one sensor's markers at rest, (n, 2) px."""

    def __init__(self, rest_px: Array) -> None:
        pitch_px = float(np.median(spacing(rest_px)))
        low, high = rest_px.min(axis=0) - MARGIN * pitch_px, rest_px.max(axis=0) + MARGIN * pitch_px
        self._low, self._high = low - 2 * pitch_px, high + 2 * pitch_px
        steps = np.clip(np.ceil((high - low) / (STEP * pitch_px)), 2, MOST_STEPS).astype(int)
        self._x, self._y = (
            np.linspace(low[axis], high[axis], steps[axis] + 1).astype(np.float32) for axis in (0, 1)
        )
        self._scale = np.float32(1 / (np.sqrt(2) * SIGMA * pitch_px))

    def of(self, markers_px: Array) -> Floats:
        """Return the density (g,) of markers at (m, 2); those far from the grid do not count."""
        near = ((markers_px > self._low) & (markers_px < self._high)).all(axis=1)
        x, y = markers_px[near].T.astype(np.float32)
        across, down = self._gaussian(self._x, x), self._gaussian(self._y, y)
        return np.asarray((down @ across.T).ravel(), dtype=np.float32)

    def _gaussian(self, grid: Floats, markers: Floats) -> Floats:
        """Return the Gaussian (g, m) along an axis, of the distances between grid (g,) and markers (m,)."""
        apart = (grid[:, None] - markers) * self._scale
        return np.asarray(np.exp(-np.minimum(apart * apart, FARTHEST)))
