"""Fit of local expansions: a label by the displacement, with slopes that depend on the pose.

Which labels the slopes depend on, how far presses count and the ridge are chosen by presses left out in turn.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from palpate_edge.calibration.pose.regression.kernel_regression import (
    MOST_FOR_SETTINGS,
    evenly,
    ridge_solution,
    squared_distances,
    standardised,
)
from palpate_edge.common.arrays import Array, Indices
from palpate_edge.estimation.pose.kernel_expansion import matern, packed
from palpate_edge.estimation.pose.local_expansion import LocalExpansion

LENGTHS = (2.0, 4.0, 8.0)  # deviations of the labels
SLOPES = (1.0, 10.0, 100.0)  # variance of what slopes explain, over that of the rest
RIDGES = (3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1, 0.3)


@dataclass(frozen=True, slots=True)
class LocalFit:
    """A fitted local expansion and its predictions (c, k) of each press from all others."""

    expansion: LocalExpansion
    left_out: Array


@dataclass(frozen=True, slots=True)
class LocalInputs:
    """Presses that local expansions are fitted to: points (c, p); first (c, l): their labels by the first
    regression without their part; centres (c,): their places in the calibration; choosing: places,
    among these, of the presses that choose settings."""

    points: Array
    first: Array
    centres: Indices
    choosing: Indices


def fit_local(
    inputs: LocalInputs, metric: Array, targets: Array, places: tuple[list[int], list[int]]
) -> LocalFit:
    """Fit targets (c, k).

    metric (p, q): of the products of points; places: of the targets and of the given ones among the labels.
    """
    labels, given = places
    deviation = np.maximum(inputs.first[:, given].std(axis=0), 1e-12)
    poses, turned = inputs.first[:, given] / deviation, inputs.points @ metric
    turned_size = np.sqrt(np.square(turned).sum(axis=1).mean())
    some = inputs.choosing
    length, slope, ridge = _choose(poses[some], turned[some] / turned_size, standardised(targets[some]))
    gain = math.sqrt(slope) / turned_size
    gram = _kernel(poses / length, turned * gain, slope)
    offset = targets.mean(axis=0)
    weights, root = ridge_solution(gram, targets - offset, ridge, slice(None))
    expansion = LocalExpansion(
        labels=tuple(labels),
        given=tuple(given),
        scale=packed(1 / (deviation * length)),
        poses=packed(poses / length),
        centres=tuple(inputs.centres.tolist()),
        metric=packed(metric * gain),
        weights=packed(weights / (1 + slope)),
        offset=packed(offset),
    )
    return LocalFit(expansion, np.asarray(targets - weights / np.square(root).sum(axis=0)[:, None]))


def _kernel(poses: Array, points: Array, slope: float) -> Array:
    """Return the kernel (c, c) with a mean of 1 on its diagonal."""
    return np.asarray(matern(squared_distances(poses)) * (1 + points @ points.T) / (1 + slope))


def _choose(poses: Array, points: Array, targets: Array) -> tuple[float, float, float]:
    """Return length, slope and ridge with the least mean absolute left-out error."""
    some = evenly(len(points), MOST_FOR_SETTINGS)
    poses, points, targets = poses[some], points[some], targets[some]
    best, least = (LENGTHS[0], SLOPES[0], RIDGES[-1]), math.inf
    for length, slope in itertools.product(LENGTHS, SLOPES):
        values, vectors = np.linalg.eigh(_kernel(poses / length, points * math.sqrt(slope), slope))
        squared, turned = vectors**2, vectors.T @ targets
        for ridge in RIDGES:
            inverse = 1 / (np.maximum(values, 0.0) + ridge)
            error = (vectors @ (inverse[:, None] * turned)) / (squared @ inverse)[:, None]
            score = float(np.abs(error).mean())
            if score < least:
                best, least = (length, slope, ridge), score
    return best
