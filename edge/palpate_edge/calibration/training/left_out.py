"""Predictions of presses by models that have not seen them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate_edge.calibration.training.samples import Samples
from palpate_edge.calibration.training.uncertainty.confidence_radius import ConfidenceRadius
from palpate_edge.common.arrays import Array


@dataclass(frozen=True, slots=True)
class LeftOut:
    """Predictions of samples by models that have not seen their press.

    samples: with forces assumed where they are unknown; directions (s, 3): unit vectors, and forces_N (s, 3),
    in the canonical frame; radius: with left-out radii of the samples; dome_N (s, 3): forces that the dome
    model alone gives on this sensor, None without one.
    """

    samples: Samples
    directions: Array
    forces_N: Array
    radius: ConfidenceRadius
    dome_N: Array | None = None


def force_misses_N(forces_N: Array, samples: Samples) -> Array:
    """Return the distances (s,) between predicted (s, 3) and true forces."""
    return np.asarray(np.linalg.norm(forces_N - samples.forces_N, axis=1))


def mean_miss_N(forces_N: Array, samples: Samples) -> float:
    """Return the mean distance between predicted (s, 3) and true forces of the plain samples."""
    return float(force_misses_N(forces_N, samples)[samples.plain].mean())
