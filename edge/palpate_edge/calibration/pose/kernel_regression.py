"""Kernel ridge regression with settings chosen by predictions of presses left out in turn."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array, Indices
from palpate_edge.estimation.pose.kernel_expansion import Expansion, matern, packed

MOST_FOR_SETTINGS = 400  # presses that settings are chosen by
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


def evenly(count: int, most: int) -> Indices:
    """Return all of `count` places, or `most` of them, evenly spaced."""
    return np.linspace(0, count - 1, min(count, most)).astype(np.intp)


def standardised(targets: Array) -> Array:
    """Return targets (s, k) about their mean, over their deviation."""
    return np.asarray((targets - targets.mean(axis=0)) / np.maximum(targets.std(axis=0), 1e-12))


def squared_distances(points: Array) -> Array:
    """Return the squared distances (s, s) between points (s, p), at least 0."""
    size = (points**2).sum(axis=1)
    return np.asarray(np.maximum(size[:, None] + size - 2 * points @ points.T, 0.0))


def kernel(points: Array) -> Array:
    """Return the kernel (s, s) between points (s, p)."""
    return np.asarray(matern(squared_distances(points)))


def choose_settings(
    points: Array, variance: Array, groups: Sequence[Array], powers: Sequence[float], lengths: Sequence[float]
) -> list[Settings]:
    """Return for each group of targets (s, k) the settings with the least mean absolute left-out error, each
    target over its deviation. At most `MOST_FOR_SETTINGS` of the points (s, m) are used."""
    some = evenly(len(points), MOST_FOR_SETTINGS)
    points = points[some]
    standard = [standardised(targets[some]) for targets in groups]
    best: list[tuple[float, Settings]] = [(math.inf, Settings(0.0, 1.0, 1.0))] * len(groups)
    for power, length in itertools.product(powers, lengths):
        values, vectors = np.linalg.eigh(kernel(points @ Settings(power, length, 0.0).metric(variance)))
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


def fit(points: Array, metric: Array, targets: Array, ridge: float) -> Fit:
    """Fit targets (s, k) at points (s, m), whose distances are taken after the product with metric (m, q)."""
    offset = targets.mean(axis=0)
    gram = kernel(points @ metric)
    gram[np.diag_indices_from(gram)] += ridge
    inverse = np.linalg.inv(gram)
    weights = inverse @ (targets - offset)
    left_out = targets - weights / np.diag(inverse)[:, None]
    return Fit(Expansion(packed(metric), packed(weights), packed(offset), "matern"), np.asarray(left_out))
