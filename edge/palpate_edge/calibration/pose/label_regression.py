"""Regression of the pose labels on the markers' displacement, with a 95 % interval for each.

Labels of one kind (both tilts, both shears) share a kernel and its metric. Errors are those of presses that
neither the fit nor the metric has seen: left out one by one from the fit; and from the learning of the
metric in parts, or, of many presses, for good. By these errors the round of the metric is chosen. The half
width of an interval follows their size about a press: their logarithm is regressed on the same points, and
raised until 95 % of the errors are within.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate_edge.calibration.pose.kernel_regression import Fit, choose_settings, evenly, fit
from palpate_edge.calibration.pose.metric_learning import (
    MOST_FOR_METRIC,
    ROUNDS,
    LearnedMetric,
    learn_metrics,
)
from palpate_edge.common.arrays import Array, Indices
from palpate_edge.estimation.pose.kernel_expansion import Expansion, packed
from palpate_edge.estimation.pose.pose_calibration import LabelGroup

COVERAGE = 0.95
FLOOR = 0.1  # of the median error, added before the logarithm
MANY_PRESSES = 1600  # so many that half of them can be kept from the learning of the metric
FEW_PRESSES = 600
PARTS_OF_FEW, PARTS = 5, 2  # few presses lose much with each one that the metric has not seen
MOST_FOR_ROUND, MOST_FOR_ERRORS = 1000, 1600  # presses that a round is chosen by, and intervals learned from
SPREAD_POWERS, SPREAD_LENGTHS = (0.0, 0.5), (1.0, 2.0, 4.0)


def fit_labels(
    points: Array, variance: Array, targets: Array, labels: Sequence[str]
) -> tuple[tuple[LabelGroup, ...], Expansion]:
    """Fit targets (s, k), one column for each of `labels`, at points (s, m) whose coordinates have this
    variance (m,); return the groups of labels and the expansion of the log half widths."""
    places = kinds_of(labels)
    columns = [targets[:, some] for some in places]
    many = len(points) >= MANY_PRESSES
    fits, errors, judged = (_fit_many if many else _fit_in_parts)(points, variance, columns)
    error = np.empty((len(judged), targets.shape[1]))
    for some, error_of_group in zip(places, errors, strict=True):
        error[:, some] = error_of_group
    groups = tuple(
        LabelGroup(tuple(some), fitted.expansion) for some, fitted in zip(places, fits, strict=True)
    )
    return groups, _fit_half_widths(points, variance, error, judged)


def kinds_of(labels: Sequence[str]) -> list[list[int]]:
    """Return the places of the labels of each kind: both tilts, both shears, each other label."""
    kinds: dict[str, list[int]] = {}
    for place, label in enumerate(labels):
        kinds.setdefault(label.split("_")[0], []).append(place)
    return list(kinds.values())


def _fit_many(points: Array, variance: Array, columns: list[Array]) -> tuple[list[Fit], list[Array], Indices]:
    """Return the fit of each group of targets, its errors, and the presses (e,) that these are of."""
    seen = evenly(len(points), min(MOST_FOR_METRIC, len(points) // 2))
    unseen = np.setdiff1d(np.arange(len(points)), seen)
    judges = unseen[evenly(len(unseen), MOST_FOR_ROUND)]
    fits = []
    for targets, rounds in zip(
        columns, learn_metrics(points[seen], variance, [some[seen] for some in columns]), strict=True
    ):
        score = [
            _mean_error(_left_out_error(points[judges], targets[judges], learned), targets)
            for learned in rounds
        ]
        best = rounds[int(np.argmin(score))]
        fits.append(fit(points, best.metric, targets, best.ridge))
    judged = unseen[evenly(len(unseen), MOST_FOR_ERRORS)]
    errors = [
        np.abs(targets - fitted.left_out)[judged] for targets, fitted in zip(columns, fits, strict=True)
    ]
    return fits, errors, judged


def _fit_in_parts(
    points: Array, variance: Array, columns: list[Array]
) -> tuple[list[Fit], list[Array], Indices]:
    """As `_fit_many`, with the errors of all presses."""
    parts = PARTS_OF_FEW if len(points) <= FEW_PRESSES else PARTS
    part = np.arange(len(points)) % parts
    errors = [np.empty((ROUNDS, *targets.shape)) for targets in columns]
    for number in range(parts):
        unseen = part == number
        learned = learn_metrics(points[~unseen], variance, [targets[~unseen] for targets in columns])
        for targets, rounds, error in zip(columns, learned, errors, strict=True):
            for place, metric in enumerate(rounds):
                error[place, unseen] = _left_out_error(points, targets, metric)[unseen]
    fits, chosen = [], []
    for targets, rounds, error in zip(columns, learn_metrics(points, variance, columns), errors, strict=True):
        best = int(np.argmin([_mean_error(of_round, targets) for of_round in error]))
        fits.append(fit(points, rounds[best].metric, targets, rounds[best].ridge))
        chosen.append(error[best])
    return fits, chosen, np.arange(len(points))


def _left_out_error(points: Array, targets: Array, learned: LearnedMetric) -> Array:
    return np.abs(targets - fit(points, learned.metric, targets, learned.ridge).left_out)


def _mean_error(error: Array, targets: Array) -> float:
    """Return the mean of errors (s, k), each over its target's deviation."""
    return float((error / np.maximum(targets.std(axis=0), 1e-12)).mean())


def _fit_half_widths(points: Array, variance: Array, error: Array, judged: Indices) -> Expansion:
    """Fit the logarithm of half widths (k,) to errors (e, k) of the `judged` (e,) presses."""
    log_error = np.log(error + FLOOR * np.median(error, axis=0) + 1e-9)
    (settings,) = choose_settings(points[judged], variance, [log_error], SPREAD_POWERS, SPREAD_LENGTHS)
    fitted = fit(points[judged], settings.metric(variance), log_error, settings.ridge)
    above = np.sort(np.log(error + 1e-12) - fitted.left_out, axis=0)
    rank = min(len(above), math.ceil(COVERAGE * (len(above) + 1))) - 1
    weights = np.zeros((len(points), error.shape[1]))
    weights[judged] = fitted.expansion.weights.array()
    offset = fitted.expansion.offset.array().astype(np.float64) + above[rank]
    return Expansion(fitted.expansion.metric, packed(weights), packed(offset), fitted.expansion.kernel)
