"""Principal components of many observations, strongest first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.estimation.pose.kernel_expansion import packed
from palpate_edge.estimation.pose.pose_calibration import Modes


@dataclass(frozen=True, slots=True)
class PrincipalModes:
    """mean (d,), vectors (d, m), variance (m,) of the coordinates."""

    mean: Array
    vectors: Array
    variance: Array

    def coordinates(self, values: Array) -> Array:
        """Return the coordinates (s, m) of values (s, d)."""
        return np.asarray((values - self.mean) @ self.vectors)

    def values(self, coordinates: Array) -> Array:
        """Return the values (s, d) of coordinates (s, m)."""
        return np.asarray(coordinates @ self.vectors.T + self.mean)

    def as_modes(self) -> Modes:
        """Return them as the calibration file has them."""
        return Modes(packed(self.mean), packed(self.vectors))


def principal_modes(values: Array, most: int) -> PrincipalModes:
    """Return the `most` strongest modes of values (s, d), fewer where there are fewer values."""
    mean = values.mean(axis=0)
    variance, vectors = np.linalg.eigh((values - mean).T @ (values - mean) / len(values))
    kept = max(1, min(most, len(values) // 3, len(mean)))
    return PrincipalModes(mean, vectors[:, ::-1][:, :kept], np.maximum(variance[::-1][:kept], 1e-12))
