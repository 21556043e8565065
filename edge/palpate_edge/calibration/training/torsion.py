"""Regression of the torsion, on the kernels that the contact's place and force are computed with.

The torsion over the field's size is a further column of the expansion's weights, so that it costs no further
kernel. It is fitted to the sensor's own presses and, with less weight, to those of the dome model, by ridge
regression in the space that the kernels of the centres span (Smola and Schoelkopf, Sparse Greedy Matrix
Approximation for Machine Learning, 2000).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate_edge.calibration.training.samples import Samples
from palpate_edge.common.arrays import Array

RIDGES = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
WEIGHTS = (0.0, 1e-3, 1e-2, 1e-1, 1.0)  # of another dome's press over a firm one of this sensor
SMALLEST_SHARE = 1e-9  # of the largest eigenvalue of the kernel matrix; smaller ones are rounding


@dataclass(frozen=True, slots=True)
class KnownTorsions:
    """Presses of other domes: kernels (d, c) of their points and the centres, target (d,) torsion over the
    field's size as it would be on this sensor, N."""

    kernels: Array
    target: Array


@dataclass(frozen=True, slots=True)
class TorsionRegression:
    """weights (c,) of the centres' kernels, whose sum is the torsion over the field's size, N.

    left_out_Nmm: (s,) predictions of the samples by fits without their press.
    """

    weights: Array
    left_out_Nmm: Array


def fit_torsion(
    kernels: Array, centre_kernels: Array, samples: Samples, others: KnownTorsions | None = None
) -> TorsionRegression:
    """Fit to the samples' torsions, which must be known, and to those of other domes if any.

    The ridge and the weight of the other domes are those that predict left-out presses of the samples best.
    kernels (s, c): of the samples' points and the centres; centre_kernels (c, c): of the centres. There is no
    offset: of a press and its mirror image the torsions are opposite.
    """
    assert samples.torsions_Nmm is not None
    size = np.linalg.norm(samples.fields, axis=1)
    target, exact = samples.torsions_Nmm / size, 1.0 / samples.faintness
    variance, vectors = np.linalg.eigh(centre_kernels)
    kept = variance > SMALLEST_SHARE * variance[-1]
    whiten = vectors[:, kept] / np.sqrt(variance[kept])
    own = (kernels @ whiten) * exact[:, None]
    groups = [np.flatnonzero(samples.press == press) for press in np.unique(samples.press)]
    best: tuple[float, Array, Array] | None = None
    for gram, moment in _normal_equations(own, target * exact, whiten, others):
        strength, axes = np.linalg.eigh(gram)
        features, moment_along = own @ axes, moment @ axes
        for ridge in RIDGES:
            shrink = 1.0 / (np.maximum(strength, 0.0) + ridge)
            solution = shrink * moment_along
            missed = _left_out(features, shrink, target * exact - features @ solution, groups) / exact * size
            score = float((missed[samples.plain] ** 2).mean())
            if best is None or score < best[0]:
                best = score, axes @ solution, missed
    assert best is not None
    _, solution, missed = best
    return TorsionRegression(whiten @ solution, samples.torsions_Nmm - missed)


def _normal_equations(
    own: Array, target: Array, whiten: Array, others: KnownTorsions | None
) -> Iterator[tuple[Array, Array]]:
    """Yield matrix and right-hand side of least squares for each weight of the other domes' presses."""
    gram, moment = own.T @ own, own.T @ target
    if others is None:
        yield gram, moment
        return
    theirs = others.kernels @ whiten
    their_gram, their_moment = theirs.T @ theirs, theirs.T @ others.target
    for weight in WEIGHTS:
        yield gram + weight * their_gram, moment + weight * their_moment


def _left_out(features: Array, shrink: Array, residual: Array, groups: list[NDArray[np.intp]]) -> Array:
    """Return what fits without each group leave of it: (1 - H_gg)^-1 of the residual, exactly."""
    missed = np.empty_like(residual)
    for group in groups:
        own = features[group]
        hat = (own * shrink) @ own.T
        missed[group] = np.linalg.solve(np.eye(len(group)) - hat, residual[group])
    return missed
