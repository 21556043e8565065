"""From canonical fields to the points between which the kernels measure distances.

A field is split into its shape (norm 1), as principal components, and the logarithm of its size. Not all of
their combinations matter alike: how wide the contact is shows in small components and changes the force,
while large ones may only show how the press is sheared. A first regression on presses of known answer shows
which matter: it changes most along them. The mean outer product of its gradients gives the metric
(Radhakrishnan et al., Science 383, 1461, 2024: recursive feature machines).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate_edge.calibration.training.gaussian_kernel import gaussian_kernel, gradient_product
from palpate_edge.common.arrays import Array

SIZE_WEIGHT = 0.3  # of the log size beside the shape, in the first regression
KEPT_VARIANCE = 0.998  # of the shapes by their principal components
LEVELLING = 0.125  # power of the components' variance that the first regression divides by
MOST_PRESSES = 1200  # that the metric is learned from
LENGTH, RIDGE = 2.0, 1e-3  # of the first regression; points have the mean square 1
POWER, FLOOR = 0.25, 1e-2  # of the eigenvalues over the largest: no combination is forgotten


@dataclass(frozen=True, slots=True)
class Projection:
    """mean (2 g,) and orthonormal components (2 g, p) of shapes; log_size: mean logarithm of the size, mm;
    metric (p + 1, q): from components and log size to points."""

    mean: Array
    components: Array
    log_size: float
    metric: Array

    def points(self, fields: Array) -> Array:
        """Return the points (s, q) of fields (s, 2 g)."""
        return np.asarray(_parts(fields, self.mean, self.components, self.log_size) @ self.metric)


def fit_projection(fields: Array, known: Array | None, targets: Array | None) -> Projection:
    """Return the components of all fields (n, 2 g), and the metric from other fields (s, 2 g) and their
    standardised targets (s, k).

    Without these all components count alike.
    """
    size = np.linalg.norm(fields, axis=1, keepdims=True)
    shapes = fields / size
    mean = shapes.mean(axis=0)
    variance, vectors = np.linalg.eigh((shapes - mean).T @ (shapes - mean))
    variance, vectors = variance[::-1], vectors[:, ::-1]
    kept = int(np.searchsorted(np.cumsum(variance) / variance.sum(), KEPT_VARIANCE)) + 1
    components, log_size = vectors[:, :kept], float(np.log(size).mean())
    if known is None or targets is None:
        metric = np.diag(np.append(np.ones(kept), SIZE_WEIGHT))
        metric = metric / _size(_parts(fields, mean, components, log_size) @ metric)
    else:
        some = np.linspace(0, len(known) - 1, min(len(known), MOST_PRESSES)).astype(np.intp)
        first = np.diag(np.append((variance[:kept] / variance[0]) ** -LEVELLING, SIZE_WEIGHT))
        metric = _learned(_parts(known[some], mean, components, log_size), first, targets[some])
    return Projection(mean, components, log_size, metric)


def _parts(fields: Array, mean: Array, components: Array, log_size: float) -> Array:
    """Return components and log size (s, p + 1)."""
    size = np.linalg.norm(fields, axis=1, keepdims=True)
    return np.concatenate([(fields / size - mean) @ components, np.log(size) - log_size], axis=1)


def _learned(parts: Array, first: Array, targets: Array) -> Array:
    """Return the metric (p + 1, q) after one regression with the metric `first`; of mean square 1."""
    first = first / _size(parts @ first)
    points = parts @ first / LENGTH
    gram = gaussian_kernel(points, points, 1.0)
    gram[np.diag_indices_from(gram)] += RIDGE
    weights: Array = np.asarray(np.linalg.solve(gram, targets), dtype=np.float64)
    values, vectors = np.linalg.eigh(gradient_product(points, weights))
    relative = np.maximum(values, 0.0) / max(float(values.max()), 1e-300)
    metric = first @ (vectors * (relative + FLOOR) ** POWER)
    return np.asarray(metric / _size(parts @ metric))


def _size(points: Array) -> float:
    """Return the root mean square distance of points (s, q) from their mean."""
    return float(np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean()))
