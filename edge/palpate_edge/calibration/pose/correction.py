"""Correction of a pose model's regression on a new sensor, learned from few presses of its own.

What the model has wrong is taken for a Gaussian process: a trend that is linear in the labels that it gives
(another sensor is stiffer, or touched later), and a smooth rest. How large each of them is does not follow
from ten presses. Therefore all settings count by how probable they make the presses (their evidence).
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from palpate_edge.calibration.evidence import mean_by_evidence
from palpate_edge.calibration.pose.regression.kernel_regression import kernel
from palpate_edge.common.arrays import Array

LENGTHS = (0.7, 1.0, 2.0, 4.0, 8.0)  # of the kernel, over that of the model
AMPLITUDES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # variance of the smooth rest
TRENDS = (0.0, 0.03, 0.1, 0.3, 1.0)  # variance of a slope
OFFSET = 0.3  # variance of what is wrong everywhere
NOISES = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
NORMAL_95 = 1.96
COVERING = 0.95


@dataclass(frozen=True, slots=True)
class OwnCorrection:
    """metric (m, q) and weights (c, k) about own points; trend (l, k) and offset (k,) of the model's labels;
    half_width (k,) of 95 % intervals."""

    metric: Array
    weights: Array
    trend: Array
    offset: Array
    half_width: Array

    def times(self, size: Array) -> OwnCorrection:
        """Return it with outputs in a unit of which `size` (k,) are one of these."""
        outputs = (self.weights, self.trend, self.offset, self.half_width)
        return OwnCorrection(self.metric, *(each * size for each in outputs))


@dataclass(frozen=True, slots=True)
class _Posterior:
    """Mean weights (c, k) of smooth rest, trend and offset, what is left (c, k) of each press by the others,
    and the logarithm of the evidence."""

    weights: Array
    smooth: Array
    slopes: Array
    left_over: Array
    log_evidence: float


def fit_correction(points: Array, metric: Array, first: Array, left: Array) -> OwnCorrection:
    """Fit what is left over (c, k) at own points (c, m), with the model's metric (m, q).

    first (c, l): the labels that the model gives, about their mean and over their deviation; left: in units
    in which a model may be off by about 1.
    """
    found = [(length, _posterior(points @ (metric / length), first, left)) for length in LENGTHS]
    length, best = max(found, key=lambda one: one[1].log_evidence)
    return OwnCorrection(
        metric / length,
        best.smooth,
        first.T @ best.slopes,
        OFFSET * best.weights.sum(axis=0),
        _half_width(best.left_over),
    )


def _posterior(points: Array, first: Array, left: Array) -> _Posterior:
    """Return the mean over all settings with the kernel of points (c, q), by their evidence."""
    smooth, linear = kernel(points), first @ first.T
    logs, found = [], []
    for amplitude, trend in itertools.product(AMPLITUDES, TRENDS):
        values, vectors = np.linalg.eigh(OFFSET + trend * linear + amplitude * smooth)
        squared, turned = vectors**2, vectors.T @ left
        for noise in NOISES:
            inverse = 1 / (np.maximum(values, 0.0) + noise)
            weights = vectors @ (inverse[:, None] * turned)
            fit = (inverse[:, None] * turned**2).sum()
            logs.append(-0.5 * float(fit - left.shape[1] * np.log(inverse).sum()))
            left_over = weights / (squared @ inverse)[:, None]
            found.append((weights, amplitude * weights, trend * weights, left_over))
    (weights, rest, slopes, left_over), log_evidence = mean_by_evidence(logs, found)
    return _Posterior(weights, rest, slopes, left_over, log_evidence)


def _half_width(error: Array) -> Array:
    """Return the half widths (k,) that hold 95 % of errors as these (c, k) of presses left out in turn.

    Of few errors the largest is not known: then the width is that of a normal distribution.
    """
    count = len(error)
    normal = NORMAL_95 * np.sqrt(np.square(error).mean(axis=0)) * (1 + 2.5 / count)
    rank = math.ceil(COVERING * (count + 1)) - 1
    if rank >= count:
        return np.asarray(normal)
    return np.asarray(np.maximum(normal, np.sort(np.abs(error), axis=0)[rank]))
