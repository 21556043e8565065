"""Coherent point drift: registration of two point sets by a smooth warp, slow and sure.

Myronenko and Song, "Point Set Registration: Coherent Point Drift", IEEE TPAMI 32(12), 2010: nonrigid.
Every point may be every other one, by probabilities that sharpen; no neighbours, no growth, no one-to-one
rule. It shares nothing with `palpate_edge.vision` and therefore judges it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array

STEPS = 40
WIDTH = 3.0  # of the warp's Gaussian, in spacings
STIFFNESS = 2.0  # weight of the warp's roughness
OUTLIERS = 0.05  # share of the targets that are no point
LEAST_SIGMA = 0.05  # spacings


@dataclass(frozen=True, slots=True)
class Drift:
    """place (n, 2): where the points went; cost: negative log likelihood with the warp's roughness."""

    place: Array
    cost: float


def drift(points: Array, targets: Array, spacing: float, sigma: float) -> Drift:
    """Warp points (n, 2) onto targets (m, 2). sigma: how far they are apart at first, as `spacing` in the
    points' unit."""
    points, targets = points / spacing, targets / spacing
    gram = np.exp(-_squared(points, points) / (2 * WIDTH**2))
    variance, weights, place = (sigma / spacing) ** 2, np.zeros_like(points), points
    area = np.ptp(targets, axis=0).prod()
    cost = np.inf
    for _ in range(STEPS):
        near = np.exp(-_squared(place, targets) / (2 * variance))
        noise = 2 * np.pi * variance * OUTLIERS / (1 - OUTLIERS) * len(points) / area
        total = near.sum(axis=0) + noise
        share = near / total
        cost = float(-np.log(total / variance).sum() + 0.5 * STIFFNESS * np.vdot(weights, gram @ weights))
        own = share.sum(axis=1)
        system = own[:, None] * gram + STIFFNESS * variance * np.eye(len(points))
        weights = np.linalg.solve(system, share @ targets - own[:, None] * points)
        place = points + gram @ weights
        variance = max((share * _squared(place, targets)).sum() / (2 * own.sum()), LEAST_SIGMA**2)
    return Drift(place * spacing, cost)


def _squared(first: Array, second: Array) -> Array:
    return np.asarray(np.square(first[:, None] - second).sum(axis=2))
