"""Metric of a kernel: which combinations of displacement modes change a label, and how much.

A fitted kernel regression changes most along what matters for its targets. The mean outer product of its
gradients over the presses (Radhakrishnan et al., Science 383, 1461, 2024: recursive feature machines) is
taken as the next metric, a few times. A tilt, for instance, hides in modes of hundredths of a pixel behind
those of depth and shear.
"""

from __future__ import annotations

import numpy as np

from palpate_edge.calibration.pose.kernel_regression import (
    MOST_FOR_SETTINGS,
    Settings,
    choose_settings,
    kernel,
    solve,
)
from palpate_edge.common.arrays import Array

ROUNDS = 2
POWERS, LENGTHS = (0.0, 0.25, 0.5, 0.75), (0.7, 1.0, 1.5, 2.5, 5.0)
FLOOR = 1e-3  # of the largest eigenvalue: no direction is forgotten


def learn_metrics(points: Array, variance: Array, groups: list[Array]) -> list[tuple[Array, float]]:
    """Return for each group of targets (s, k) the metric (m, m) and the ridge of its kernel.

    points (s, m): with coordinates of this variance (m,). At most MOST_FOR_SETTINGS of them are used.
    """
    some = np.linspace(0, len(points) - 1, min(len(points), MOST_FOR_SETTINGS)).astype(np.intp)
    points, groups = points[some], [targets[some] for targets in groups]
    chosen = choose_settings(points, variance, groups, POWERS, LENGTHS)
    return [_refined(points, variance, *pair) for pair in zip(groups, chosen, strict=True)]


def _refined(points: Array, variance: Array, targets: Array, settings: Settings) -> tuple[Array, float]:
    """Return metric and ridge after `ROUNDS` of gradients."""
    metric = settings.metric(variance)
    off = (targets - targets.mean(axis=0)) / np.maximum(targets.std(axis=0), 1e-12)
    for _ in range(ROUNDS):
        scaled = points @ metric
        weights, _ = solve(scaled, off, settings.ridge)
        values, vectors = np.linalg.eigh(_gradients(scaled, weights))
        relative = np.maximum(values, 0.0) / max(values.max(), 1e-300)
        turned = metric @ (vectors * (relative + FLOOR) ** 0.25)
        coordinates = points @ turned
        variance = coordinates.var(axis=0) + 1e-12
        (settings,) = choose_settings(coordinates, variance, [targets], (0.0,), LENGTHS)
        metric = turned @ settings.metric(variance)
    return metric, settings.ridge


def _gradients(points: Array, weights: Array) -> Array:
    """Return the mean outer product (q, q) of the gradients, at points (s, q), of all targets (s, k)."""
    gram = kernel(points, points)
    total = np.zeros((points.shape[1],) * 2)
    for column in weights.T:
        pull = gram * column
        gradient = pull @ points - pull.sum(axis=1)[:, None] * points
        total += gradient.T @ gradient
    return total / len(points)
