"""The 95 % half width of a prediction, from errors of presses left out in turn.

The logarithm of the error is fitted by a line in the logarithm of the field's size and in the blind spot. The
line is raised so that 95 % of the left-out errors stay below it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate_edge.calibration.training.samples import Samples
from palpate_edge.common.arrays import Array

COVERAGE = 0.95
FLOOR = 1e-3  # of the largest error; a luckily small error says nothing
FEWEST_PRESSES = 5
FLATTERY_PRESSES = 3.0  # see confidence_radius


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
    design = np.stack([np.ones_like(log_size), log_size, samples.hidden], axis=1)
    (level, size_slope, hidden_slope), *_ = np.linalg.lstsq(design, log_error, rcond=None)
    hidden_slope = max(0.0, float(hidden_slope))
    above = log_error - level - size_slope * log_size - hidden_slope * samples.hidden
    plain = np.sort(above[samples.plain])
    # The plain samples are the presses and their mirror images: as many independent errors as presses.
    rank = min(1.0, COVERAGE * (1 + 1 / presses))
    limit = float(np.quantile(plain, rank)) + math.log1p(FLATTERY_PRESSES / presses)
    return Interval(float(level) + limit, float(size_slope), hidden_slope)
