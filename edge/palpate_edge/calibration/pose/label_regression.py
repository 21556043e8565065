"""Regression of the pose labels on the markers' displacement, with a 95 % interval for each.

Labels of one kind (both tilts, both shears) share a kernel and its metric. The half width of an interval
follows the size of errors about a press: their logarithm is regressed on the same points, and raised until
95 % of the errors are within. These errors are of presses that neither the fit nor the metric has seen: they
are left out one by one from the fit, and in parts from the learning of the metric.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate_edge.calibration.pose.kernel_regression import choose_settings, fit
from palpate_edge.calibration.pose.metric_learning import learn_metrics
from palpate_edge.common.arrays import Array, Mask
from palpate_edge.estimation.pose.kernel_expansion import Expansion, packed
from palpate_edge.estimation.pose.pose_calibration import LabelGroup

COVERAGE = 0.95
FLOOR = 0.1  # of the median error, added before the logarithm
MOST_FOR_ERRORS = 2400  # presses whose errors the intervals are learned from
MANY_PRESSES = 600
PARTS_OF_FEW, PARTS_OF_MANY = 5, 2  # few presses lose much with each one that the metric has not seen
SPREAD_POWERS, SPREAD_LENGTHS = (0.0, 0.5), (1.0, 2.0, 4.0)


def fit_labels(
    points: Array, variance: Array, targets: Array, labels: Sequence[str]
) -> tuple[tuple[LabelGroup, ...], Expansion]:
    """Fit targets (s, k), one column for each of `labels`, at points (s, m) whose coordinates have this
    variance (m,); return the groups of labels and the expansion of the log half widths."""
    kinds: dict[str, list[int]] = {}
    for place, label in enumerate(labels):
        kinds.setdefault(label.split("_")[0], []).append(place)
    places = list(kinds.values())
    metrics = learn_metrics(points, variance, [targets[:, some] for some in places])
    groups = tuple(
        LabelGroup(tuple(some), fit(points, metric, targets[:, some], ridge).expansion)
        for some, (metric, ridge) in zip(places, metrics, strict=True)
    )
    return groups, _fit_half_widths(points, variance, targets, places)


def _fit_half_widths(points: Array, variance: Array, targets: Array, places: list[list[int]]) -> Expansion:
    """Fit the logarithm of half widths (k,)."""
    some = np.linspace(0, len(points) - 1, min(len(points), MOST_FOR_ERRORS)).astype(np.intp)
    error = np.empty((len(some), targets.shape[1]))
    parts = PARTS_OF_FEW if len(some) <= MANY_PRESSES else PARTS_OF_MANY
    for part in range(parts):
        unseen = np.arange(len(some)) % parts == part
        error[unseen] = _errors(points[some], variance, targets[some], places, ~unseen)[unseen]
    log_error = np.log(error + FLOOR * np.median(error, axis=0) + 1e-9)
    (settings,) = choose_settings(points[some], variance, [log_error], SPREAD_POWERS, SPREAD_LENGTHS)
    fitted = fit(points[some], settings.metric(variance), log_error, settings.ridge)
    above = np.sort(np.log(error + 1e-12) - fitted.left_out, axis=0)
    rank = min(len(above), math.ceil(COVERAGE * (len(above) + 1))) - 1
    weights = np.zeros((len(points), targets.shape[1]))
    weights[some] = fitted.expansion.weights.array()
    offset = fitted.expansion.offset.array().astype(np.float64) + above[rank]
    return Expansion(fitted.expansion.metric, packed(weights), packed(offset))


def _errors(points: Array, variance: Array, targets: Array, places: list[list[int]], seen: Mask) -> Array:
    """Return the left-out errors (s, k) with metrics that were learned from the `seen` (s,) presses."""
    error = np.empty_like(targets)
    metrics = learn_metrics(points[seen], variance, [targets[seen][:, some] for some in places])
    for some, (metric, ridge) in zip(places, metrics, strict=True):
        error[:, some] = np.abs(targets[:, some] - fit(points, metric, targets[:, some], ridge).left_out)
    return error
