"""Kernel expansions of a regression, and several of them as one with fewer centres."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from palpate_edge.calibration.training.compress import compressed
from palpate_edge.calibration.training.gaussian_kernel import gaussian_kernel
from palpate_edge.calibration.training.uncertainty.confidence_radius import ConfidenceRadius
from palpate_edge.common.arrays import Array

MOST_CENTRES = 900
COMMON_LENGTH = 1.5  # of the kernel about the centres that are kept
PLACE_SHARE, RADIUS_SHARE = 4.0, 0.1  # of misses in the choice of centres, beside those of the force
LEAST_DEVIATION = 1e-9  # of a log radius, which is constant without presses
OWN_IMPORTANCE = 5.0  # of the sensor's own samples where centres are left out, over the dome model's


@dataclass(frozen=True, slots=True)
class TrainedExpansion:
    """Centres with their kernel's length and weights (c, k), and what is added to their sum (k,)."""

    centres: Array
    length: float
    weights: Array
    offset: Array

    def at(self, points: Array) -> Array:
        """Return the sums (s, k) at points (s, q)."""
        return np.asarray(gaussian_kernel(points, self.centres, self.length) @ self.weights + self.offset)


def joined_expansion(
    base: TrainedExpansion | None,
    own: list[TrainedExpansion],
    radius: ConfidenceRadius,
    strange: Array | None,
) -> TrainedExpansion:
    """Return all expansions, with the log radius beside them, as one of at most `MOST_CENTRES`.

    own: of the same centres; strange (d,): confidence_radius.strangeness at the dome model's centres, which
    come first.
    """
    parts = list(own)
    if base is not None:
        no_radius = np.zeros(len(base.centres))
        parts.insert(
            0,
            TrainedExpansion(
                base.centres,
                base.length,
                np.column_stack([base.weights, no_radius]),
                np.append(base.offset, 0.0),
            ),
        )
    offset = np.sum([part.offset for part in parts], axis=0) + radius.level * np.eye(7)[6]
    if not own and len(parts[0].centres) <= MOST_CENTRES:
        return replace(parts[0], offset=offset)
    centres = np.concatenate([part.centres for part in parts[: 1 + (base is not None)]])
    values = np.sum(
        [gaussian_kernel(centres, part.centres, part.length) @ part.weights for part in parts], axis=0
    )
    if strange is not None:
        values[: len(strange), 6] += np.log(strange)
    taught = len(own[0].centres) if own else 0
    importance = np.where(np.arange(len(centres)) < len(centres) - taught, 1.0, OWN_IMPORTANCE)
    common = COMMON_LENGTH if own else parts[0].length
    fewer, weights = compressed(
        centres, values, lambda a, b: gaussian_kernel(a, b, common), MOST_CENTRES, importance, _units(values)
    )
    return TrainedExpansion(fewer, common, weights, offset)


def _units(values: Array) -> Array:
    """Return the units (7,) of misses of direction, force over size, and log radius (n, 7)."""
    deviation = values.std(axis=0)
    direction, force = (float(np.linalg.norm(deviation[part])) for part in (slice(3), slice(3, 6)))
    radius = max(float(deviation[6]), LEAST_DEVIATION)
    return np.repeat([direction / PLACE_SHARE, force, radius / RADIUS_SHARE], [3, 3, 1])
