"""The 95 % radius of a prediction: errors of presses left out in turn, smoothed and raised to cover 95 %.

Errors are taken in parts of what a faint touch must err by (skin_motion.faintness) and of what one must that
is far from all presses known (:func:`strangeness`): a dome is the same all around, but not at another polar
angle. What is left of them has much the same distribution on every sensor, so that few presses need not
determine all of it: some of a typical sensor are added (:mod:`upper_limit`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from palpate_edge.calibration.training.inverse_factor import inverse_factor
from palpate_edge.calibration.training.samples import Samples
from palpate_edge.calibration.training.uncertainty.upper_limit import TypicalErrors, upper_limit
from palpate_edge.common.arrays import Array, Mask

RIDGE = 0.3  # times the root of the number of samples
FLOOR = 1 / 1500  # of the dome's radius; a luckily small error says nothing
UNTAUGHT = 1 / 40  # 95 % radius over the dome's without presses of the sensor itself, nothing hidden
UNTAUGHT_HIDDEN_SLOPE = 1.3
OPEN = 1.6  # 95 % of contacts up to 75 deg are off by less, over the dome's radius and the angles' deviation
STRANGER_DEG = 10.0  # from the nearest known polar angle: errors may be twice as large
# Six sensors of the twin (seeds 40 to 43, 46, 47), each calibrated three times with 5, 10, 20 and 50 presses.
PRIOR_MEDIAN = 1 / 110  # of the dome's radius
PRIOR_LEVEL_PRESSES = 5.0  # how many presses the median weighs
TYPICAL = TypicalErrors(NormalDist(0.0, 0.70), flattery_presses=4.0)


@dataclass(frozen=True, slots=True)
class ConfidenceRadius:
    """log radius = level + kernel sum with weights (s,) + hidden_slope times the hidden beads' blind spot.

    held (s,): whether the left-out error of a sample is within its left-out radius; left_out_mm (s,): that
    radius, as wide as the touch is faint; limit: part of the level, the limit of the logarithms of errors
    over the typical one. The last two are empty and 0 without presses.
    """

    level: float
    weights: Array
    hidden_slope: float
    held: Mask
    left_out_mm: Array
    limit: float


def constant_radius(radius_mm: float, open_rad: float = 0.0) -> ConfidenceRadius:
    """Return the radius for a sensor of which no press is known.

    radius_mm: of its dome; open_rad: standard deviation of the contacts' angles that nothing determines, as
    the camera's roll before a learned layout.
    """
    return ConfidenceRadius(
        float(np.log(math.hypot(UNTAUGHT, OPEN * open_rad) * radius_mm)),
        np.zeros(0),
        UNTAUGHT_HIDDEN_SLOPE,
        np.zeros(0, np.bool_),
        np.zeros(0),
        0.0,
    )


def strangeness(directions: Array, known: Array) -> Array:
    """(n,): how many times farther off a contact at each of the unit vectors (n, 3) may be for having none of
    the known ones (m, 3) at its polar angle, 1 or more."""
    theta_deg, known_deg = (np.degrees(np.arccos(np.clip(d[:, 2], -1.0, 1.0))) for d in (directions, known))
    return np.asarray(1.0 + np.abs(theta_deg[:, None] - known_deg).min(axis=1) / STRANGER_DEG)


def fit_radius(
    gram: Array, error_mm: Array, samples: Samples, groups: list[NDArray[np.intp]], radius_mm: float
) -> ConfidenceRadius:
    """From the left-out errors (s,) of the samples and the kernel (s, s) between them."""
    presses = len(groups)
    farther = samples.faintness * _left_out_strangeness(samples, groups)
    log_error = np.log(error_mm / farther + FLOOR * radius_mm)
    design = np.stack([np.ones_like(log_error), samples.hidden], axis=1)
    (level, slope), *_ = np.linalg.lstsq(design, log_error, rcond=None)
    slope = max(0.0, float(slope))
    known = PRIOR_LEVEL_PRESSES * np.log(PRIOR_MEDIAN * radius_mm)
    level = (presses * level + known) / (presses + PRIOR_LEVEL_PRESSES)
    rest = log_error - level - slope * samples.hidden
    factor = inverse_factor(gram + RIDGE * len(gram) ** 0.5 * np.eye(len(gram)))
    weights = factor.T @ (factor @ rest)
    above = left_out_residuals(factor, weights[:, None], groups)[:, 0]
    limit = upper_limit(above[samples.plain], presses, TYPICAL)
    left_out_mm = farther * np.exp(log_error - above + limit)
    return ConfidenceRadius(
        float(level) + limit, weights, slope, np.asarray(above <= limit), left_out_mm, limit
    )


def combined_radius(
    radius: ConfidenceRadius, error_mm: Array, samples: Samples, radius_mm: float
) -> tuple[float, Mask]:
    """Return the 95 % radius of other places of the same samples over `radius`, and whether it holds (s,).

    error_mm (s,): left-out errors of these places; radius: of the samples; radius_mm: of the dome.
    """
    floor_mm = FLOOR * radius_mm * samples.faintness
    above = np.log((error_mm + floor_mm) / radius.left_out_mm) + radius.limit
    presses = len(np.unique(samples.press))
    limit = upper_limit(above[samples.plain], presses, TYPICAL)
    return float(np.exp(limit - radius.limit)), np.asarray(above <= limit)


def _left_out_strangeness(samples: Samples, groups: list[NDArray[np.intp]]) -> Array:
    """(s,): of each sample when nothing but the other presses is known."""
    found = np.ones(len(samples.press))
    places = samples.directions[[group[0] for group in groups]]
    for number, group in enumerate(groups):
        others = np.delete(places, number, axis=0)
        if len(others):
            found[group] = strangeness(samples.directions[group], others)
    return found


def left_out_residuals(factor: Array, weights: Array, groups: list[NDArray[np.intp]]) -> Array:
    """Target minus prediction for every sample, by a model that has seen nothing of its press.

    factor: inverse_factor of K + ridge. For a group g of rows the residual is
    [(K + ridge)^-1]_gg^-1 weights_g: exact, without a second fit.
    """
    residual = np.empty_like(weights)
    for group in groups:
        columns = factor[group.min() :, group]  # zero above
        residual[group] = np.linalg.solve(columns.T @ columns, weights[group])
    return residual
