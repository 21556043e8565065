"""Correction of a pose model's regression on a new sensor, learned from few presses of its own.

The model's error on the new sensor is modelled as a Gaussian process: a trend that is linear in the labels
that the model predicts (another sensor is stiffer, or touched later), and a smooth remainder. Tips are nearly
isotropic, so the error of a vector, tilt or shear, is mainly a linear combination of the predicted vectors
with complex coefficients: one coefficient scales and turns a vector in any direction, where a trend of each
label has four. Ten presses do not determine the size of each part. All settings are therefore averaged,
weighted by the probability of the presses under each (their evidence).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate_edge.calibration.evidence import mean_by_evidence
from palpate_edge.calibration.pose.label_vectors import LabelVector
from palpate_edge.calibration.pose.regression.kernel_regression import kernel
from palpate_edge.common.arrays import Array

LENGTHS = (0.7, 1.0, 2.0, 4.0, 8.0)  # of the kernel, over that of the model
AMPLITUDES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # variance of the smooth rest
TRENDS = (0.0, 0.03, 0.1, 0.3, 1.0)  # variance of a slope
TURNS = (0.0, 0.1, 0.3, 1.0, 3.0)  # variance of a coefficient of a vector
MOST_TURNED = 100  # presses; more show the trend of each label
OFFSET = 0.3  # variance of what is wrong everywhere
NOISES = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
NORMAL_95 = 1.96
COVERING = 0.95

Complex = NDArray[np.complex128]
Values = Array | Complex


@dataclass(frozen=True, slots=True)
class OwnCorrection:
    """metric (m, q) and weights (c, k) about own points; trend (l, k) and offset (k,) of the model's labels;
    half_width (k,) of 95 % intervals."""

    metric: Array
    weights: Array
    trend: Array
    offset: Array
    half_width: Array

    def in_units(self, deviation: Array, size: Array) -> OwnCorrection:
        """Return it for labels and outputs in other units, of which deviation (l,) and size (k,) are one of
        these."""
        outputs = (self.weights, self.trend / deviation[:, None], self.offset, self.half_width)
        return OwnCorrection(self.metric, *(each * size for each in outputs))


@dataclass(frozen=True, slots=True)
class _Posterior:
    """Mean weights (c, k) of smooth rest, trend, vectors, and all of them, what is left (c, k) of each press
    by the others, and the logarithm of the evidence. Of a vector k is 1, and all are complex."""

    smooth: Values
    slopes: Values
    vectors: Values
    weights: Values
    left_over: Values
    log_evidence: float


def fit_correction(
    points: Array,
    metric: Array,
    first: Array,
    left: Array,
    vector: LabelVector | None = None,
    vectors: Sequence[LabelVector] = (),
) -> OwnCorrection:
    """Fit what is left over (c, k) at own points (c, m), with the model's metric (m, q).

    first (c, l): the labels that the model gives, about their mean and over their deviation; left: in units
    in which a model may be off by about 1. vector: of which `left` has x and y, None where it has other
    labels; vectors: among the labels that the model gives.
    """
    turning = [one for one in vectors if one.sense]
    if vector is None or not vector.sense or len(points) > MOST_TURNED:
        vector, turning = None, []
    moved = np.array([one.in_image(first) for one in turning]).reshape(len(turning), len(first)).T
    outputs: Values = left if vector is None else vector.moved_to(0).in_image(left)[:, None]
    found = [(length, _posterior(points @ (metric / length), first, moved, outputs)) for length in LENGTHS]
    length, best = max(found, key=lambda one: one[1].log_evidence)
    smooth, trend, offset, left_over = (
        _real(values, vector)
        for values in (
            best.smooth,
            first.T @ best.slopes,
            OFFSET * best.weights.sum(axis=0, keepdims=True),
            best.left_over,
        )
    )
    for one, coefficient in zip(turning, moved.conj().T @ best.vectors, strict=True):
        along = np.array([coefficient, 1j * one.sense * coefficient])  # for its x and its y
        trend[list(one.places)] += _real(along, vector)
    return OwnCorrection(metric / length, smooth, trend, offset[0], _half_width(left_over))


def _real(values: Values, vector: LabelVector | None) -> Array:
    """Return values (c, k) as they are, those of a vector, (c, 1), as its x and y (c, 2)."""
    if vector is None:
        return np.asarray(values.real)
    return vector.parts(values[:, 0])


def _posterior(points: Array, first: Array, moved: Complex, left: Values) -> _Posterior:
    """Return the mean over all settings with the kernel of points (c, q), by their evidence.

    first (c, l): labels; moved (c, v): vectors among them, none where `left` (c, k) is no vector.
    """
    smooth, linear, alike = kernel(points), first @ first.T, moved @ moved.conj().T
    numbers = 2 if np.iscomplexobj(left) else left.shape[1]
    logs, found = [], []
    for amplitude, trend, turn in itertools.product(AMPLITUDES, TRENDS, TURNS if moved.size else (0.0,)):
        covariance = OFFSET + trend * linear + amplitude * smooth
        values, modes = np.linalg.eigh(covariance + turn * alike if turn else covariance)
        squared, turned = np.abs(modes) ** 2, modes.conj().T @ left
        for noise in NOISES:
            inverse = 1 / (np.maximum(values, 0.0) + noise)
            weights = modes @ (inverse[:, None] * turned)
            fit = float((inverse[:, None] * np.abs(turned) ** 2).sum())
            logs.append(-0.5 * (fit - numbers * float(np.log(inverse).sum())))
            left_over = weights / (squared @ inverse)[:, None]
            found.append((amplitude * weights, trend * weights, turn * weights, weights, left_over))
    (rest, slopes, vectors, weights, left_over), log_evidence = mean_by_evidence(logs, found)
    return _Posterior(rest, slopes, vectors, weights, left_over, log_evidence)


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
