"""How far a prediction may be off: errors of presses left out in turn, smoothed and raised to cover 95 %.

Errors are taken in parts of what a faint touch must err by (motion.faintness). What is left of them has much
the same spread on every sensor, so that few presses need not tell all of it: beside them stand as many of a
typical sensor as `PRIOR_PRESSES`, drawn from a log-normal distribution.
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from palpate_edge.training.samples import Samples

Array = NDArray[np.float64]

COVERAGE = 0.95
RIDGE = 0.3  # times the root of the number of samples
FLOOR = 1 / 1500  # of the dome's radius; a luckily small error says nothing
UNTAUGHT = 1 / 40  # 95 % radius over the dome's without presses of the sensor itself, nothing hidden
UNTAUGHT_HIDDEN_SLOPE = 2.0
# Five sensors of the twin (seeds 20, 21, 22, 25, 26) calibrated with 5 to 20 presses: median and deviation.
PRIOR_MEDIAN = 1 / 150  # of the dome's radius
PRIOR_DEVIATION = 0.62  # of the logarithm
PRIOR_LEVEL_PRESSES = 5.0  # how many presses the median weighs
PRIOR_PRESSES = 10  # how many the deviation weighs


@dataclass(frozen=True, slots=True)
class Spread:
    """log radius = level + kernel sum with weights (s,) + hidden_slope times the hidden share of beads."""

    level: float
    weights: Array
    hidden_slope: float


def constant_spread(radius_mm: float) -> Spread:
    """For a sensor of which no press is known; radius_mm: of its dome."""
    return Spread(float(np.log(UNTAUGHT * radius_mm)), np.zeros(0), UNTAUGHT_HIDDEN_SLOPE)


def fit_spread(
    gram: Array, error_mm: Array, samples: Samples, groups: list[NDArray[np.intp]], radius_mm: float
) -> Spread:
    """From the left-out errors (s,) of the samples and the kernel (s, s) between them."""
    presses = len(groups)
    log_error = np.log(error_mm / samples.faintness + FLOOR * radius_mm)
    design = np.stack([np.ones_like(log_error), samples.hidden], axis=1)
    (level, slope), *_ = np.linalg.lstsq(design, log_error, rcond=None)
    slope = max(0.0, float(slope))
    known = PRIOR_LEVEL_PRESSES * np.log(PRIOR_MEDIAN * radius_mm)
    level = (presses * level + known) / (presses + PRIOR_LEVEL_PRESSES)
    rest = log_error - level - slope * samples.hidden
    inverse = np.linalg.inv(gram + RIDGE * len(gram) ** 0.5 * np.eye(len(gram)))
    weights = inverse @ rest
    above = left_out_residuals(inverse, weights[:, None], groups)[:, 0]
    return Spread(float(level) + _upper_limit(above[samples.plain], presses), weights, slope)


def _upper_limit(above: Array, presses: int) -> float:
    """What 95 % of new values stay below: the quantile of the sensor's own presses and the typical ones
    together."""
    typical = NormalDist(0.0, PRIOR_DEVIATION)
    prior = [typical.inv_cdf((number + 0.5) / 1000) for number in range(1000)]
    values = np.concatenate([above, prior])
    weight = np.repeat([presses / len(above), PRIOR_PRESSES / len(prior)], [len(above), len(prior)])
    order = np.argsort(values)
    below = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(below, COVERAGE * below[-1])])


def left_out_residuals(inverse: Array, weights: Array, groups: list[NDArray[np.intp]]) -> Array:
    """Target minus prediction for every sample, by a model that has seen nothing of its press.

    For a group g of rows the residual is [(K + ridge)^-1]_gg^-1 weights_g: exact, without a second fit.
    """
    residual = np.empty_like(weights)
    for group in groups:
        residual[group] = np.linalg.solve(inverse[np.ix_(group, group)], weights[group])
    return residual
