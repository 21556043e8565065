"""Regression of the pose labels on the markers' displacement, with a 95 % interval for each.

Labels of one kind (both tilts, both shears) share a kernel and its metric. First results are those of a
kernel regression; local regressions (local_regression.py) about them may be better, and networks
(motion_networks.py) about both for shear and torsion. Errors are those of
presses that neither fit nor metric has seen: left out one by one from the fit; and from the learning of the
metric, and the choice of settings, in parts, or, of many presses, from the metric for good. By these errors
the metric's round and the regression are chosen; an interval takes errors of the regression that other
presses choose, as the least errors of several regressions are small by chance, too. The half width of an
interval follows their size about a press: their logarithm is regressed on the same points, and raised until
95 % of the errors are within.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate_edge.calibration.pose.regression.kernel_regression import choose_settings, evenly, fit
from palpate_edge.calibration.pose.regression.label_candidates import Candidates, fit_candidates
from palpate_edge.calibration.pose.regression.metric_learning import (
    MOST_FOR_METRIC,
    LearnedMetric,
    learn_metrics,
)
from palpate_edge.calibration.pose.regression.motion_networks import MotionNetworks, fit_motion_networks
from palpate_edge.common.arrays import Array, Indices
from palpate_edge.estimation.pose.kernel_expansion import Expansion, packed
from palpate_edge.estimation.pose.local_expansion import LocalExpansion
from palpate_edge.estimation.pose.network import Networks
from palpate_edge.estimation.pose.pose_calibration import LabelGroup

COVERAGE = 0.95
FLOOR = 0.1  # of the median error, added before the logarithm
MANY_PRESSES = 1200  # so many that half of them can be kept from the learning of the metric
MOST_LOCAL = 4000  # presses of local regressions
FEW_PRESSES = 300
# Presses lose with each one that the metric has not seen. Halves made intervals of tilt from 500 presses hold
# 97 %, thirds 96 % (means over draws of train presses of a TacTip).
PARTS_OF_FEW, PARTS = 5, 3
PARTS_OF_CHOICE = 5
MOST_FOR_ROUND, MOST_FOR_ERRORS = 1000, 1600  # presses that a round is chosen by, and intervals learned from
SPREAD_POWERS, SPREAD_LENGTHS = (0.0, 0.5), (1.0, 2.0, 4.0)
LEAST_GAIN = 0.05  # of the variance of log errors, from which on a width follows the press


@dataclass(frozen=True, slots=True)
class FittedLabels:
    """groups and local: expansions of the labels; networks: corrections of their sum, None without any;
    half_widths: expansion of the log half widths."""

    groups: tuple[LabelGroup, ...]
    local: tuple[LocalExpansion, ...]
    networks: Networks | None
    half_widths: Expansion


def fit_labels(points: Array, variance: Array, targets: Array, labels: Sequence[str]) -> FittedLabels:
    """Fit targets (s, k), one column for each of `labels`, at points (s, m) whose coordinates have this
    variance (m,)."""
    kinds = _named_kinds(labels)
    data = _Data(points, variance, targets, kinds)
    moving = None
    if len(points) >= MANY_PRESSES:
        candidates, errors, judged = _fit_many(data)
        moving = _if_better(fit_motion_networks(candidates, kinds, judged), errors)
    else:
        candidates, errors, judged = _fit_in_parts(data)
    error, groups, local = np.empty((len(judged), len(labels))), [], []
    for group, places in enumerate(kinds.values()):
        if moving and group in moving.errors:
            best, error[:, places] = candidates.mean_of_local(group), moving.errors[group]
        else:
            best = _least(errors[group])
            error[:, places] = errors_of_choice(errors[group])
        groups.append(LabelGroup(tuple(places), candidates.first[group].expansion))
        local += candidates.expansions(group, best)
    return FittedLabels(
        groups=tuple(groups),
        local=tuple(local),
        networks=moving.networks if moving else None,
        half_widths=_fit_half_widths(points, variance, error, judged),
    )


def _if_better(moving: MotionNetworks | None, errors: list[list[Array]]) -> MotionNetworks | None:
    """Return networks whose errors are less, in the mean, than the least of each kind they correct."""
    if moving is None:
        return None
    ratios = [
        (error.mean(axis=0) / np.maximum(errors[kind][_least(errors[kind])].mean(axis=0), 1e-12)).mean()
        for kind, error in moving.errors.items()
    ]
    return moving if np.mean(ratios) < 1 else None


def kinds_of(labels: Sequence[str]) -> list[list[int]]:
    """Return the places of the labels of each kind: both tilts, both shears, each other label."""
    return list(_named_kinds(labels).values())


def _named_kinds(labels: Sequence[str]) -> dict[str, list[int]]:
    kinds: dict[str, list[int]] = {}
    for place, label in enumerate(labels):
        kinds.setdefault(label.split("_")[0], []).append(place)
    return kinds


@dataclass(frozen=True, slots=True)
class _Data:
    """Points (s, m), the variance (m,) of their coordinates, targets (s, k), and the places of each kind of
    target."""

    points: Array
    variance: Array
    targets: Array
    kinds: dict[str, list[int]]

    def learn_metrics(self, seen: Indices) -> list[list[LearnedMetric]]:
        """Learn the metrics of each kind, of every round, from the `seen` presses."""
        groups = [self.targets[seen][:, places] for places in self.kinds.values()]
        return learn_metrics(self.points[seen], self.variance, groups)

    def fit_candidates(
        self, metrics: list[list[LearnedMetric]], rounds: list[int], choosing: Indices
    ) -> Candidates:
        """Fit every candidate with the metrics of these rounds, one of each kind.

        choosing: presses that choose settings.
        """
        centres = evenly(len(self.points), MOST_LOCAL)
        return fit_candidates(self.points, self.targets, self.kinds, metrics, rounds, centres, choosing)

    def round_errors(self, metrics: list[list[LearnedMetric]], some: Indices) -> list[list[Array]]:
        """Return the errors (e, k) at `some` (e,) presses for each kind and each of its rounds, each press
        left out in turn from a fit to them."""
        errors = []
        for places, learned in zip(self.kinds.values(), metrics, strict=True):
            targets = self.targets[some][:, places]
            fits = (fit(self.points[some], each.metric, targets, each.ridge) for each in learned)
            errors.append([np.abs(targets - fitted.left_out) for fitted in fits])
        return errors


def _fit_many(data: _Data) -> tuple[Candidates, list[list[Array]], Indices]:
    """Return the candidates, the errors (e, k) of each kind and candidate, and the presses (e,) these are of.

    Half of the presses, or MOST_FOR_METRIC, are for the metric, and others judge.
    """
    count = len(data.points)
    seen = evenly(count, min(MOST_FOR_METRIC, count // 2))
    unseen = np.setdiff1d(evenly(count, MOST_LOCAL), seen)
    metrics = data.learn_metrics(seen)
    judges = unseen[evenly(len(unseen), MOST_FOR_ROUND)]
    rounds = [_least(of_kind) for of_kind in data.round_errors(metrics, judges)]
    candidates = data.fit_candidates(metrics, rounds, np.arange(count))
    judged = unseen[evenly(len(unseen), MOST_FOR_ERRORS)]
    return candidates, candidates.errors(judged), judged


def _fit_in_parts(data: _Data) -> tuple[Candidates, list[list[Array]], Indices]:
    """As `_fit_many`, with all presses, each judged by metrics that were learned without its part."""
    presses = np.arange(len(data.points))
    parts = PARTS_OF_FEW if len(presses) <= FEW_PRESSES else PARTS
    unseen = [presses[presses % parts == number] for number in range(parts)]
    seen = [np.setdiff1d(presses, part) for part in unseen]
    metrics = [data.learn_metrics(part) for part in seen]
    by_round = [
        [[error[part] for error in of_kind] for of_kind in data.round_errors(learned, presses)]
        for part, learned in zip(unseen, metrics, strict=True)
    ]
    rounds = [_least(of_kind) for of_kind in _joined(by_round)]
    by_candidate = [
        data.fit_candidates(learned, rounds, choosing).errors(part)
        for part, choosing, learned in zip(unseen, seen, metrics, strict=True)
    ]
    final = data.fit_candidates(data.learn_metrics(presses), rounds, presses)
    return final, _joined(by_candidate), np.concatenate(unseen)


def _joined(parts: list[list[list[Array]]]) -> list[list[Array]]:
    """Return the errors of all parts, for each kind and each choice."""
    return [
        [np.concatenate(choice) for choice in zip(*of_kind, strict=True)]
        for of_kind in zip(*parts, strict=True)
    ]


def _least(errors: list[Array]) -> int:
    """Return which of some errors (e, k) are least in the mean."""
    size = np.maximum(np.mean(errors, axis=(0, 1)), 1e-12)
    return int(np.argmin([(error / size).mean() for error in errors]))


def errors_of_choice(errors: list[Array]) -> Array:
    """Return the errors (e, k) of a choice among those (e, k) of some candidates: each press has those of the
    candidate that is best at the presses of other parts."""
    part = np.arange(len(errors[0])) % PARTS_OF_CHOICE
    chosen = np.empty_like(errors[0])
    for number in range(PARTS_OF_CHOICE):
        there = part == number
        if there.any():
            chosen[there] = errors[_least([error[~there] for error in errors])][there]
    return chosen


def _fit_half_widths(points: Array, variance: Array, error: Array, judged: Indices) -> Expansion:
    """Fit the logarithm of half widths (k,) to errors (e, k) of the `judged` (e,) presses.

    A label whose errors those about a press hardly predict has the same width everywhere.
    """
    log_error = np.log(error + FLOOR * np.median(error, axis=0) + 1e-9)
    (settings,) = choose_settings(points[judged], variance, [log_error], SPREAD_POWERS, SPREAD_LENGTHS)
    fitted = fit(points[judged], settings.metric(variance), log_error, settings.ridge)
    mean = log_error.mean(axis=0)
    without = mean - (log_error - mean) / (len(judged) - 1)  # the mean of all others
    left_over, spread = (np.square(log_error - one).sum(axis=0) for one in (fitted.left_out, without))
    varies = left_over < (1 - LEAST_GAIN) * spread
    above = np.sort(np.log(error + 1e-12) - np.where(varies, fitted.left_out, mean), axis=0)
    rank = min(len(above), math.ceil(COVERAGE * (len(above) + 1))) - 1
    weights = np.zeros((len(points), error.shape[1]))
    weights[judged] = np.where(varies, fitted.expansion.weights.array(), 0.0)
    return Expansion(
        fitted.expansion.metric, packed(weights), packed(mean + above[rank]), fitted.expansion.kernel
    )
