"""Gaussian kernel ridge regression with settings chosen by predictions of presses left out in turn."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.estimation.pose.kernel_expansion import Expansion, packed

MOST_FOR_SETTINGS = 1200  # presses that settings are chosen by
RIDGES = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0)


@dataclass(frozen=True, slots=True)
class Settings:
    """power: how far modes are brought to one size, 0 (not at all) to 1; length of the kernel over the root
    mean square size of the points; ridge: noise of a target over its variance."""

    power: float
    length: float
    ridge: float

    def metric(self, variance: Array) -> Array:
        """Return the metric (m, m) of coordinates of this variance (m,) in the kernel's units."""
        relative = variance ** (-self.power / 2)
        return np.diag(relative / (np.sqrt((relative**2 * variance).sum()) * self.length))


@dataclass(frozen=True, slots=True)
class Fit:
    """A fitted expansion, and its predictions (s, k) of each press from all others."""

    expansion: Expansion
    left_out: Array


def kernel(points: Array, centres: Array) -> Array:
    """Return exp(-d^2 / 2) between points (s, p) and centres (c, p)."""
    squared = (points**2).sum(axis=1)[:, None] + (centres**2).sum(axis=1) - 2 * points @ centres.T
    return np.asarray(np.exp(-0.5 * np.maximum(squared, 0.0)))


def choose_settings(
    points: Array, variance: Array, groups: Sequence[Array], powers: Sequence[float], lengths: Sequence[float]
) -> list[Settings]:
    """Return for each group of targets (s, k) the settings with the least mean absolute left-out error, each
    target over its deviation."""
    some = np.linspace(0, len(points) - 1, min(len(points), MOST_FOR_SETTINGS)).astype(np.intp)
    points = points[some]
    standard = [_standardised(targets[some]) for targets in groups]
    best: list[tuple[float, Settings]] = [(math.inf, Settings(0.0, 1.0, 1.0))] * len(groups)
    for power, length in itertools.product(powers, lengths):
        scaled = points @ Settings(power, length, 0.0).metric(variance)
        values, vectors = np.linalg.eigh(kernel(scaled, scaled))
        squared = vectors**2
        turned = [vectors.T @ targets for targets in standard]
        for ridge in RIDGES:
            inverse = 1 / (np.maximum(values, 0.0) + ridge)
            own = (squared @ inverse)[:, None]
            for group, targets in enumerate(turned):
                score = float(np.abs((vectors @ (inverse[:, None] * targets)) / own).mean())
                if score < best[group][0]:
                    best[group] = score, Settings(power, length, ridge)
    return [settings for _, settings in best]


def _standardised(targets: Array) -> Array:
    return np.asarray((targets - targets.mean(axis=0)) / np.maximum(targets.std(axis=0), 1e-12))


def fit(points: Array, metric: Array, targets: Array, ridge: float) -> Fit:
    """Fit targets (s, k) at points (s, m), whose distances are taken after the product with metric (m, q)."""
    offset = targets.mean(axis=0)
    weights, inverse = solve(points @ metric, targets - offset, ridge)
    left_out = targets - weights / np.diag(inverse)[:, None]
    return Fit(Expansion(packed(metric), packed(weights), packed(offset)), np.asarray(left_out))


def solve(points: Array, targets: Array, ridge: float) -> tuple[Array, Array]:
    """Return the weights (s, k) and the inverse of the kernel with its ridge (s, s)."""
    gram = kernel(points, points)
    gram[np.diag_indices_from(gram)] += ridge
    inverse = np.linalg.inv(gram)
    return np.asarray(inverse @ targets), np.asarray(inverse)
