"""Local regression: labels that are linear in the markers' displacement, with slopes that depend on the pose.

How far markers turn by a degree of torsion depends on depth and tilt. Therefore presses count by how near
their pose is to the one that a first regression gives (kernel_expansion.py), and among them the label follows
the displacement along a plane.
"""

from __future__ import annotations

import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Floats
from palpate_edge.estimation.pose.kernel_expansion import PackedArray, matern, packed


class LocalExpansion(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Outputs (k,) at a point (p,) with first labels (l,): offset + sum over centres of
    matern(d) (1 + the products of point and centre) weights.

    labels: places of the outputs among the labels; given: places of the labels (g,) that distances d are
    taken in, after the product with scale (g,); poses (c, g): of the centres, in that scale; centres (c,):
    places among the calibration's centres; metric (p, q): points are multiplied with it; weights (c, k),
    offset (k,).
    """

    labels: tuple[int, ...]
    given: tuple[int, ...]
    scale: PackedArray
    poses: PackedArray
    centres: tuple[int, ...]
    metric: PackedArray
    weights: PackedArray
    offset: PackedArray

    def over(self, count: int) -> LocalExpansion:
        """Return it with outputs divided by `count`; outputs for the same labels are added."""
        weights, offset = packed(self.weights.array() / count), packed(self.offset.array() / count)
        return msgspec.structs.replace(self, weights=weights, offset=offset)


class LocalExpansionRunner:
    """Computes one local expansion about centres (c, p)."""

    def __init__(self, expansion: LocalExpansion, centres: Array | Floats) -> None:
        self.labels = list(expansion.labels)
        self._given = list(expansion.given)
        self._scale = expansion.scale.array()
        self._poses = np.ascontiguousarray(expansion.poses.array().T, np.float64)  # sums over rows are fast
        self._metric = expansion.metric.array()
        self._points = np.ascontiguousarray(centres[list(expansion.centres)] @ self._metric, np.float32)
        self._weights = expansion.weights.array().astype(np.float64)
        self._offset = expansion.offset.array()

    def has_nearness_of(self, other: LocalExpansionRunner) -> bool:
        """Return whether both have the same nearness for the same labels."""
        return (
            self._given == other._given
            and np.array_equal(self._scale, other._scale)
            and np.array_equal(self._poses, other._poses)
        )

    def nearness(self, first: Array) -> Array:
        """Return how near (c,) the centres' poses are to the labels `first` (l,) of the first regression."""
        apart = self._poses - (first[self._given] * self._scale)[:, None]
        return matern(np.square(apart).sum(axis=0))

    def at(self, point: Floats, nearness: Array) -> Floats:
        """Return the outputs (k,) at one point (p,); nearness (c,): see :meth:`nearness`."""
        near = nearness * (1.0 + self._points @ (point @ self._metric))
        return np.asarray(near @ self._weights + self._offset, dtype=np.float32)
