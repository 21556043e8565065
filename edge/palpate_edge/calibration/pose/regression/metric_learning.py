"""Metric of a kernel: which combinations of displacement modes change a label, and how much.

A fitted kernel regression changes most along what matters for its targets. The mean outer product of its
gradients over the presses (Radhakrishnan et al., Science 383, 1461, 2024: recursive feature machines) is
taken as the next metric, a few times. A tilt, for instance, hides in modes of hundredths of a pixel behind
those of depth and shear. How often pays depends on the label: each round's metric is returned.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate_edge.calibration.pose.regression.kernel_regression import (
    Settings,
    choose_settings,
    evenly,
    squared_distances,
    standardised,
)
from palpate_edge.common.arrays import Array
from palpate_edge.estimation.pose.kernel_expansion import ROOT_3, matern

ROUNDS = 3
MOST_FOR_METRIC = 1200  # presses that gradients are taken at
POWERS, LENGTHS = (0.0, 0.25, 0.5, 0.75), (0.7, 1.4, 2.8, 5.6)
LENGTHS_AGAIN = (0.35, 0.6, 1.0, 1.7)  # longer ones make weights too large for single precision
FLOOR = 1e-3  # of the largest eigenvalue: no direction is forgotten


@dataclass(frozen=True, slots=True)
class LearnedMetric:
    """metric (m, m) and ridge of a kernel regression."""

    metric: Array
    ridge: float


def learn_metrics(points: Array, variance: Array, groups: list[Array]) -> list[list[LearnedMetric]]:
    """Return for each group of targets (s, k) the metric and ridge after each of `ROUNDS` rounds.

    points (s, m): with coordinates of this variance (m,). At most MOST_FOR_METRIC of them are used.
    """
    some = evenly(len(points), MOST_FOR_METRIC)
    points, groups = points[some], [targets[some] for targets in groups]
    chosen = choose_settings(points, variance, groups, POWERS, LENGTHS)
    return [_refined(points, variance, *pair) for pair in zip(groups, chosen, strict=True)]


def _refined(points: Array, variance: Array, targets: Array, settings: Settings) -> list[LearnedMetric]:
    metric, off = settings.metric(variance), standardised(targets)
    learned = []
    for _ in range(ROUNDS):
        values, vectors = np.linalg.eigh(_gradients(points @ metric, off, settings.ridge))
        relative = np.maximum(values, 0.0) / max(values.max(), 1e-300)
        turned = metric @ (vectors * (relative + FLOOR) ** 0.25)
        coordinates = points @ turned
        variance = coordinates.var(axis=0) + 1e-12
        (settings,) = choose_settings(coordinates, variance, [targets], (0.0,), LENGTHS_AGAIN)
        metric = turned @ settings.metric(variance)
        learned.append(LearnedMetric(metric, settings.ridge))
    return learned


def _gradients(points: Array, targets: Array, ridge: float) -> Array:
    """Return the mean outer product (q, q) of the gradients, at points (s, q), of a fit to targets (s, k)."""
    squared = squared_distances(points)
    gram = matern(squared)
    gram[np.diag_indices_from(gram)] += ridge
    weights = np.linalg.solve(gram, targets)
    slope = np.exp(-ROOT_3 * np.sqrt(squared))  # the kernel's gradient is -3 slope (x - centre)
    total = np.zeros((points.shape[1],) * 2)
    for column in weights.T:
        pull = slope * column
        gradient = pull @ points - pull.sum(axis=1)[:, None] * points
        total += gradient.T @ gradient
    return total / len(points)
