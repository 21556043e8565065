"""Kernel ridge regression from canonical fields to contact direction, force and uncertainty.

The field is split into its shape (norm 1) and its size (logarithm of the norm): a press keeps nearly the
same shape while it deepens, so shape tells the place, and force over size is nearly constant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate_edge.training.samples import Samples

Array = NDArray[np.float64]

SIZE_WEIGHT = 0.3  # of the log size beside the shape
KEPT_VARIANCE = 0.9995  # of the shapes by their principal components
LENGTHS = (1.5, 2.2)
RIDGES = (1e-4, 1e-3)
FORCE_IN_MM = 0.2  # 1 % of the largest force weighs like 0.2 mm when settings are compared
SPREAD_RIDGE = 0.3
RADIUS_FLOOR_MM = 0.02
COVERAGE = 0.95


@dataclass(frozen=True, slots=True)
class Regression:
    """A fitted model.

    mean (2 g,), components (2 g, p): projection of shapes; centres (c, p + 1); weights (c, 7): direction,
    force over size in N/mm, log radius; offset (7,); hidden_slope: log radius a hidden share; length.
    """

    mean: Array
    components: Array
    centres: Array
    weights: Array
    offset: Array
    hidden_slope: float
    length: float

    def features(self, fields: Array) -> Array:
        """(s, 2 g) fields -> (s, p + 1) points of the kernel's space."""
        size = np.linalg.norm(fields, axis=1, keepdims=True)
        shape = (fields / size - self.mean) @ self.components
        return np.concatenate([shape, SIZE_WEIGHT * np.log(size)], axis=1)

    def predict(self, fields: Array, hidden: Array) -> tuple[Array, Array, Array]:
        """Unit directions (s, 3), forces (s, 3) N and 95 % radii (s,) mm."""
        raw = _gauss(self.features(fields), self.centres, self.length) @ self.weights + self.offset
        direction = raw[:, :3] / np.linalg.norm(raw[:, :3], axis=1, keepdims=True)
        force = raw[:, 3:6] * np.linalg.norm(fields, axis=1, keepdims=True)
        return direction, force, np.exp(raw[:, 6] + self.hidden_slope * hidden)


def fit(samples: Samples, radius_mm: float, progress: Callable[[int, int], None]) -> Regression:
    """Fit on all samples; settings and uncertainty come from predictions of presses left out in turn.

    radius_mm: of the dome, on which position errors are measured.
    """
    steps = len(LENGTHS) * len(RIDGES) + 2
    base = _projection(samples)
    features = base.features(samples.fields)
    target = _targets(samples)
    offset: Array = np.asarray(target.mean(axis=0), dtype=np.float64)
    groups = [np.flatnonzero(samples.press == press) for press in np.unique(samples.press)]
    best: _Setting | None = None
    for length in LENGTHS:
        gram = _gauss(features, features, length)
        for ridge in RIDGES:
            inverse = np.asarray(np.linalg.inv(gram + ridge * np.eye(len(gram))), dtype=np.float64)
            weights = inverse @ (target - offset)
            held_out = target - _left_out_residuals(inverse, weights, groups)
            error_mm, score = _score(held_out, samples, radius_mm)
            if best is None or score < best.score:
                best = _Setting(score, length, weights, error_mm, gram)
            progress(LENGTHS.index(length) * len(RIDGES) + RIDGES.index(ridge) + 1, steps)
    assert best is not None
    log_error = np.log(best.error_mm + RADIUS_FLOOR_MM)
    spread_offset, spread_weights, slope = _fit_spread(best.gram, log_error, samples, groups)
    progress(steps, steps)
    return replace(
        base,
        centres=features,
        weights=np.concatenate([best.weights, spread_weights[:, None]], axis=1),
        offset=np.concatenate([offset, [spread_offset]]),
        hidden_slope=slope,
        length=best.length,
    )


@dataclass(frozen=True, slots=True)
class _Setting:
    """The best settings so far: weights (s, 6), left-out position errors (s,) mm, gram matrix (s, s)."""

    score: float
    length: float
    weights: Array
    error_mm: Array
    gram: Array


def _projection(samples: Samples) -> Regression:
    """Principal components of the shapes; everything else still empty."""
    shapes = samples.fields / np.linalg.norm(samples.fields, axis=1, keepdims=True)
    mean = shapes.mean(axis=0)
    variance, vectors = np.linalg.eigh((shapes - mean).T @ (shapes - mean))
    kept = int(np.searchsorted(np.cumsum(variance[::-1]) / variance.sum(), KEPT_VARIANCE)) + 1
    empty = np.zeros((0, 0))
    return Regression(mean, vectors[:, ::-1][:, :kept], empty, empty, np.zeros(7), 0.0, 1.0)


def _targets(samples: Samples) -> Array:
    """(s, 6): direction, and force over the field's size."""
    size = np.linalg.norm(samples.fields, axis=1, keepdims=True)
    return np.concatenate([samples.directions, samples.forces_N / size], axis=1)


def _left_out_residuals(inverse: Array, weights: Array, groups: list[NDArray[np.intp]]) -> Array:
    """Target minus prediction for every sample, by a model that has seen nothing of its press.

    For a group g of rows the residual is [(K + ridge)^-1]_gg^-1 weights_g: exact, without a second fit.
    """
    residual = np.empty_like(weights)
    for group in groups:
        residual[group] = np.linalg.solve(inverse[np.ix_(group, group)], weights[group])
    return residual


def _score(prediction: Array, samples: Samples, radius_mm: float) -> tuple[Array, float]:
    """Position errors (s,) in mm, and how bad position and force are on the plain samples."""
    direction = prediction[:, :3] / np.linalg.norm(prediction[:, :3], axis=1, keepdims=True)
    error_mm = radius_mm * np.linalg.norm(direction - samples.directions, axis=1)
    size = np.linalg.norm(samples.fields, axis=1, keepdims=True)
    force_error = np.linalg.norm(prediction[:, 3:6] * size - samples.forces_N, axis=1)[samples.plain]
    largest = float(np.linalg.norm(samples.forces_N, axis=1).max())
    relative = float(np.sqrt((force_error**2).mean())) / largest
    return error_mm, float(error_mm[samples.plain].mean()) + FORCE_IN_MM * 100 * relative


def _fit_spread(
    gram: Array, log_error: Array, samples: Samples, groups: list[NDArray[np.intp]]
) -> tuple[float, Array, float]:
    """A smooth log error over the kernel's space, raised until it covers 95 % of the left-out presses."""
    design = np.stack([np.ones_like(log_error), samples.hidden], axis=1)
    (level, slope), *_ = np.linalg.lstsq(design, log_error, rcond=None)
    slope = max(0.0, float(slope))
    rest = log_error - level - slope * samples.hidden
    inverse = np.linalg.inv(gram + SPREAD_RIDGE * len(gram) ** 0.5 * np.eye(len(gram)))
    weights = inverse @ rest
    above = _left_out_residuals(inverse, weights[:, None], groups)[:, 0]
    presses = len(groups)
    share = min(1.0, np.ceil((presses + 1) * COVERAGE) / presses)  # a quantile from few presses needs room
    return float(level + np.quantile(above[samples.plain], share)), weights, slope


def _gauss(a: Array, b: Array, length: float) -> Array:
    """Gaussian kernel (n, m)."""
    squared = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1)[None] - 2 * a @ b.T
    return np.asarray(np.exp(-np.maximum(0.0, squared) / (2 * length**2)))
