"""The 95 % half width of a prediction, from errors of presses left out in turn.

The logarithm of the error is fitted by a line in the logarithm of the field's size and in the blind spot. Its
slope in the size is drawn to that of typical sensors, as few presses do not determine it. The line is raised
so that 95 % of the errors stay below it (:mod:`upper_limit`).
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from palpate_edge.calibration.training.samples import Samples
from palpate_edge.calibration.training.uncertainty.upper_limit import TypicalErrors, upper_limit
from palpate_edge.common.arrays import Array

FLOOR = 1e-3  # of the largest error; a luckily small error says nothing
FEWEST_PRESSES = 5
# Five sensors of the twin (seeds 401 to 403, 405, 406), each calibrated with 6 to 150 presses.
TYPICAL_SLOPE = 0.6
SLOPE_PRESSES = 20  # how many presses of unit deviation the typical slope weighs
HIDDEN_RIDGE = 1e-6  # for samples without hidden beads
TYPICAL = TypicalErrors(NormalDist(0.2, 0.8), flattery_presses=8.0)


@dataclass(frozen=True, slots=True)
class Interval:
    """log half width = level + size_slope * log(field's size) + hidden_slope * blind spot."""

    level: float
    size_slope: float
    hidden_slope: float

    def half_width(self, fields: Array, hidden: Array) -> Array:
        """Return the half widths (s,) for fields (s, 2 g) with blind spots (s,)."""
        log_size = np.log(np.linalg.norm(fields, axis=1))
        return np.asarray(np.exp(self.level + self.size_slope * log_size + self.hidden_slope * hidden))


def fit_interval(error: Array, samples: Samples) -> Interval | None:
    """Fit to the left-out errors (s,) of the samples, 0 or more; None from fewer than `FEWEST_PRESSES`."""
    presses = len(np.unique(samples.press))
    if presses < FEWEST_PRESSES or not error.any():
        return None
    log_error = np.log(error + FLOOR * error.max())
    log_size = np.log(np.linalg.norm(samples.fields, axis=1))
    middle = log_size.mean()
    design = np.stack([np.ones_like(log_size), log_size - middle, samples.hidden], axis=1)
    known = TYPICAL_SLOPE * (log_size - middle)
    weight = np.array([0.0, SLOPE_PRESSES * len(error) / presses, HIDDEN_RIDGE])
    level, further_slope, hidden_slope = np.linalg.solve(
        design.T @ design + np.diag(weight), design.T @ (log_error - known)
    )
    slope = TYPICAL_SLOPE + float(further_slope)
    hidden_slope = max(0.0, float(hidden_slope))
    above = log_error - level - slope * (log_size - middle) - hidden_slope * samples.hidden
    # The plain samples are the presses and their mirror images: as many independent errors as presses.
    limit = upper_limit(above[samples.plain], presses, TYPICAL)
    return Interval(float(level - slope * middle) + limit, slope, hidden_slope)
