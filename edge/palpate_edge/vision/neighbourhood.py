"""Neighbourhoods of beads: how far beads lie apart in the reference, and averages over a bead's neighbours.

Distances are relative: in spacings of the bead at the centre, where a bead's spacing is the distance to the
nearest other bead. Averages weigh neighbours by a Gaussian of that distance.
"""

from __future__ import annotations

import math

import numpy as np

from palpate_edge.common.arrays import Array, Floats, Indices, Mask
from palpate_edge.geometry.points import distances
from palpate_edge.kernels.neighbourhood import NeighbourMeans

LEAST_WEIGHT = 1e-200  # of all found neighbours; below, weights lose digits and are scaled first


class Neighbourhood:
    """Distances between n beads at fixed places.

    distance_px (n, n); spacing_px (n,); relative (n, n): row i holds the distances from bead i over its
    spacing; means: of the neighbours' displacements.
    """

    def __init__(self, position_px: Array) -> None:
        """position_px (n, 2): the beads of the untouched sensor."""
        self.position_px = position_px
        self.distance_px = distances(position_px, position_px)
        apart = self.distance_px.copy()
        np.fill_diagonal(apart, np.inf)
        self.spacing_px: Array = apart.min(axis=1)
        self.relative = self.distance_px / self.spacing_px[:, None]
        self.means = NeighbourMeans(position_px, self.relative, LEAST_WEIGHT)

    def weights(self, length: float) -> Array:
        """Return Gaussian weights (n, n) of each bead's neighbours; length: standard deviation, spacings."""
        return gaussian(self.relative / length)

    def pairs(self, limit: float) -> tuple[Indices, Indices]:
        """Return the pairs (p,), (p,) of beads less than `limit` spacings apart."""
        first, second = np.nonzero(np.triu(self.distance_px < limit * self.spacing_px[:, None], k=1))
        return first, second

    def nearest(self, count: int) -> Indices:
        """Return the `count` nearest neighbours (n, count) of each bead."""
        return np.asarray(np.argsort(self.relative, axis=1)[:, 1 : count + 1])

    def predict(self, position_px: Array, found: Mask, missing: Indices) -> Array:
        """Return places (m, 2) of the `missing` beads (m,), displaced like their `found` neighbours.

        Without any found bead these are the reference places.
        """
        return self.means.predict(position_px, found, missing)


def gaussian(distance: Array) -> Array:
    """Return exp(-d^2 / 2)."""
    return np.asarray(np.exp(-0.5 * distance**2))


def interpolate(relative: Array, values: Array) -> Array:
    """Return the Gaussian-weighted means (m, k) of `values` (n, k) at relative distances (m, n).

    Weights are scaled so that the nearest value has weight 1: far from all values none underflows.
    """
    exponent = 0.5 * relative**2
    weight = np.exp(exponent.min(axis=1, keepdims=True) - exponent)
    return np.asarray(weight @ values / weight.sum(axis=1, keepdims=True))


def row_normalised(weight: Array) -> Array:
    """Return the weights with every row scaled to sum 1: its product with values is a weighted mean."""
    return np.asarray(weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-12))


def rms(vectors: Array | Floats) -> float:
    """Return the root mean square length of vectors (n, 2); 0 without vectors."""
    flat = vectors.ravel()
    return math.sqrt(float(flat @ flat) / max(1, len(vectors)))
