"""How far a prediction may be off: errors of presses left out in turn, smoothed and raised to cover 95 %."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate_edge.training.samples import Samples

Array = NDArray[np.float64]

COVERAGE = 0.95
FEWEST_FOR_A_QUANTILE = 40  # presses; of fewer the largest errors say too little
RIDGE = 0.3  # times the root of the number of samples
RADIUS_FLOOR_MM = 0.02
UNTAUGHT_RADIUS_MM = 1.0  # without presses of the sensor itself; on the press sample 0.5 to 0.7 would do
UNTAUGHT_HIDDEN_SLOPE = 2.0


@dataclass(frozen=True, slots=True)
class Spread:
    """log radius = level + kernel sum with weights (s,) + hidden_slope times the hidden share of beads."""

    level: float
    weights: Array
    hidden_slope: float


def constant_spread() -> Spread:
    """For a sensor of which no press is known."""
    return Spread(float(np.log(UNTAUGHT_RADIUS_MM)), np.zeros(0), UNTAUGHT_HIDDEN_SLOPE)


def fit_spread(gram: Array, error_mm: Array, samples: Samples, groups: list[NDArray[np.intp]]) -> Spread:
    """From the left-out errors (s,) of the samples and the kernel (s, s) between them."""
    log_error = np.log(error_mm + RADIUS_FLOOR_MM)
    design = np.stack([np.ones_like(log_error), samples.hidden], axis=1)
    (level, slope), *_ = np.linalg.lstsq(design, log_error, rcond=None)
    slope = max(0.0, float(slope))
    rest = log_error - level - slope * samples.hidden
    inverse = np.linalg.inv(gram + RIDGE * len(gram) ** 0.5 * np.eye(len(gram)))
    weights = inverse @ rest
    above = left_out_residuals(inverse, weights[:, None], groups)[:, 0]
    return Spread(float(level) + _upper_limit(above[samples.plain], len(groups)), weights, slope)


def _upper_limit(above: Array, presses: int) -> float:
    """What 95 % of new values stay below: a quantile, or from few presses a one-sided prediction limit of a
    normal distribution (Student's t is 1.645 + 2 / (n - 1) within 2 % from n = 5 on)."""
    if presses >= FEWEST_FOR_A_QUANTILE:
        return float(np.quantile(above, min(1.0, np.ceil((presses + 1) * COVERAGE) / presses)))
    student = 1.645 + 2.0 / max(1, presses - 1)
    return float(above.mean() + student * above.std() * np.sqrt(1 + 2 / presses))


def left_out_residuals(inverse: Array, weights: Array, groups: list[NDArray[np.intp]]) -> Array:
    """Target minus prediction for every sample, by a model that has seen nothing of its press.

    For a group g of rows the residual is [(K + ridge)^-1]_gg^-1 weights_g: exact, without a second fit.
    """
    residual = np.empty_like(weights)
    for group in groups:
        residual[group] = np.linalg.solve(inverse[np.ix_(group, group)], weights[group])
    return residual
