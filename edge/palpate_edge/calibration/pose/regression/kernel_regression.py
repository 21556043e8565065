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
BLOCK = 256  # rows of a triangular matrix that are solved at once
PARTS = 10  # of predictions without a part
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
    """A fitted expansion, and its predictions (e, k) of presses: left_out from all others, in_parts from nine
    tenths of them.

    A second regression on such predictions needs those in parts. Where each press is left out by itself, its
    prediction is less by a little of its own noise, as all targets have one sum; a regression finds that.
    """

    expansion: Expansion
    left_out: Array
    in_parts: Array


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


def fit(
    points: Array, metric: Array, targets: Array, ridge: float, judged: Indices | slice = slice(None)
) -> Fit:
    """Fit targets (s, k) at points (s, m), whose distances are taken after the product with metric (m, q).

    judged (e,): the presses to predict from all others.
    """
    offset = targets.mean(axis=0)
    weights, roots = ridge_solution(kernel(points @ metric), targets - offset, ridge, judged)
    left_over = np.empty((2, *weights[judged].shape))
    left_over[0] = weights[judged] / np.square(roots).sum(axis=0)[:, None]
    for part in range(PARTS):
        root = roots[:, part::PARTS]
        left_over[1, part::PARTS] = np.linalg.solve(root.T @ root, weights[judged][part::PARTS])
    left_out, in_parts = targets[judged] - left_over
    return Fit(Expansion(packed(metric), packed(weights), packed(offset), "matern"), left_out, in_parts)


def ridge_solution(gram: Array, targets: Array, ridge: float, judged: Indices | slice) -> tuple[Array, Array]:
    """Return the weights (s, k) = inverse of (gram + ridge) @ targets, and a root (s, e) of that inverse: at
    the `judged` (e,) places it is root.T @ root. The gram matrix (s, s) is changed."""
    gram[np.diag_indices_from(gram)] += ridge
    lower: Array = np.asarray(np.linalg.cholesky(gram))
    weights = solve_lower(lower, targets)
    weights = solve_lower(lower.T[::-1, ::-1], weights[::-1])[::-1]
    return weights, solve_lower(lower, np.eye(len(gram))[:, judged])


def solve_lower(lower: Array, right: Array) -> Array:
    """Return x (s, k) with lower @ x = right, of a lower triangular matrix (s, s)."""
    solution = np.empty_like(right)
    for start in range(0, len(right), BLOCK):
        rows = slice(start, start + BLOCK)
        rest = right[rows] - lower[rows, :start] @ solution[:start]
        solution[rows] = np.linalg.solve(lower[rows, rows], rest)
    return solution
