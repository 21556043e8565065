"""Correction of a pose model's regression on a new sensor, learned from few presses of its own."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from palpate_edge.calibration.pose.regression.kernel_regression import fit
from palpate_edge.common.arrays import Array
from palpate_edge.estimation.pose.kernel_expansion import Expansion, packed

LENGTHS = (0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0)  # of the kernel, over that of the model
RIDGES = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0)  # the last: nearly a constant
NORMAL_95 = 1.96
COVERING = 0.95


@dataclass(frozen=True, slots=True)
class OwnCorrection:
    """metric (m, q) and weights (c, k) about own points, offset (k,); half_width (k,) of 95 % intervals."""

    metric: Array
    weights: Array
    offset: Array
    half_width: Array

    def expansion(self, before: Array) -> Expansion:
        """Return the expansion about other centres, with these weights (s, k), followed by the own ones."""
        return Expansion(
            packed(self.metric), packed(np.vstack([before, self.weights])), packed(self.offset), "matern"
        )


def fit_correction(points: Array, metric: Array, left: Array) -> OwnCorrection:
    """Fit what is left over (c, k) at own points (c, m), with the model's metric (m, q).

    Kernel length and ridge are those with the least mean absolute error on presses left out in turn.
    """
    best, least = None, math.inf
    for length, ridge in itertools.product(LENGTHS, RIDGES):
        fitted = fit(points, metric / length, left, ridge)
        score = float(np.abs(left - fitted.left_out).mean())
        if score < least:
            best, least, scaled = fitted, score, metric / length
    assert best is not None
    return OwnCorrection(
        scaled,
        best.expansion.weights.array().astype(np.float64),
        best.expansion.offset.array().astype(np.float64),
        _half_width(left - best.left_out),
    )


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
