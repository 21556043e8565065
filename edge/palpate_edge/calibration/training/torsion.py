"""Regression of the torsion, on the kernels that the contact's place and force are computed with.

The torsion over the field's size is a further column of the expansion's weights, so that it costs no further
kernel. It is fitted to the sensor's own presses alone, by ridge regression in the space that the kernels of
the centres span (Smola and Schoelkopf, Sparse Greedy Matrix Approximation for Machine Learning, 2000).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate_edge.calibration.training.samples import Samples
from palpate_edge.common.arrays import Array

RIDGES = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
SMALLEST_SHARE = 1e-9  # of the largest eigenvalue of the kernel matrix; smaller ones are rounding


@dataclass(frozen=True, slots=True)
class TorsionRegression:
    """weights (c,) of the centres' kernels, whose sum is the torsion over the field's size, N.

    left_out_Nmm: (s,) predictions of the samples by fits without their press.
    """

    weights: Array
    left_out_Nmm: Array


def fit_torsion(kernels: Array, centre_kernels: Array, samples: Samples) -> TorsionRegression:
    """Fit to the samples' torsions, which must be known, with the ridge that predicts left-out presses best.

    kernels (s, c): of the samples' points and the centres; centre_kernels (c, c): of the centres. There is no
    offset: of a press and its mirror image the torsions are opposite.
    """
    assert samples.torsions_Nmm is not None
    size = np.linalg.norm(samples.fields, axis=1)
    target, exact = samples.torsions_Nmm / size, 1.0 / samples.faintness
    variance, vectors = np.linalg.eigh(centre_kernels)
    kept = variance > SMALLEST_SHARE * variance[-1]
    whiten = vectors[:, kept] / np.sqrt(variance[kept])
    weighted = (kernels @ whiten) * exact[:, None]
    strength, axes = np.linalg.eigh(weighted.T @ weighted)
    features = weighted @ axes
    groups = [np.flatnonzero(samples.press == press) for press in np.unique(samples.press)]
    best: tuple[float, Array, Array] | None = None
    for ridge in RIDGES:
        shrink = 1.0 / (np.maximum(strength, 0.0) + ridge)
        solution = shrink * (features.T @ (target * exact))
        missed = _left_out(features, shrink, target * exact - features @ solution, groups) / exact * size
        score = float((missed[samples.plain] ** 2).mean())
        if best is None or score < best[0]:
            best = score, solution, missed
    assert best is not None
    _, solution, missed = best
    return TorsionRegression(whiten @ (axes @ solution), samples.torsions_Nmm - missed)


def _left_out(features: Array, shrink: Array, residual: Array, groups: list[NDArray[np.intp]]) -> Array:
    """Return what fits without each group leave of it: (1 - H_gg)^-1 of the residual, exactly."""
    missed = np.empty_like(residual)
    for group in groups:
        own = features[group]
        hat = (own * shrink) @ own.T
        missed[group] = np.linalg.solve(np.eye(len(group)) - hat, residual[group])
    return missed
