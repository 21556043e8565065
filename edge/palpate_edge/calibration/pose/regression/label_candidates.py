"""Candidates of one label's regression: the first one, and local ones about its results.

Candidate 0 is the kernel regression. Then the local regressions follow, by each set of given labels, and last
their mean.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate_edge.calibration.pose.regression.kernel_regression import Fit, fit
from palpate_edge.calibration.pose.regression.local_regression import LocalFit, LocalInputs, fit_local
from palpate_edge.calibration.pose.regression.metric_learning import LearnedMetric
from palpate_edge.common.arrays import Array, Indices
from palpate_edge.estimation.pose.local_expansion import LocalExpansion


@dataclass(frozen=True, slots=True)
class Candidates:
    """first: the kernel regression of each kind of label; local: the local regressions of each kind; both
    predict the `centres` (c,), presses in rising order, from all others; targets: of each kind there."""

    centres: Indices
    targets: list[Array]
    first: list[Fit]
    local: list[list[LocalFit]]

    def errors(self, judged: Indices) -> list[list[Array]]:
        """Return the errors (e, k) of each kind and candidate at the `judged` (e,) presses."""
        at = np.searchsorted(self.centres, judged)
        errors = []
        for targets, first, local in zip(self.targets, self.first, self.local, strict=True):
            predicted = [first.left_out, *(fitted.left_out for fitted in local)]
            if len(local) > 1:
                predicted.append(np.mean(predicted[1:], axis=0))
            errors.append([np.abs(targets - one)[at] for one in predicted])
        return errors

    def mean_of_local(self, kind: int) -> int:
        """Return the candidate that is the mean of all local regressions of a kind."""
        count = len(self.local[kind])
        return count + 1 if count > 1 else count

    def expansions(self, kind: int, candidate: int) -> list[LocalExpansion]:
        """Return the local expansions whose sum is this candidate, none of the first."""
        local = [fitted.expansion for fitted in self.local[kind]]
        if candidate <= len(local):
            return local[candidate - 1 : candidate] if candidate else []
        return [expansion.over(len(local)) for expansion in local]


def fit_candidates(
    points: Array,
    targets: Array,
    kinds: dict[str, list[int]],
    metrics: list[list[LearnedMetric]],
    rounds: list[int],
    centres: Indices,
    choosing: Indices,
) -> Candidates:
    """Fit all candidates to targets (s, k) at points (s, m).

    kinds: places of the labels of each kind; metrics: of each kind, by round; rounds: which of them the first
    regression of each kind takes; centres (c,): presses that local regressions are fitted to; choosing: those
    that choose the settings of local regressions.
    """
    columns = [targets[:, places] for places in kinds.values()]
    first, predicted = [], np.empty((len(centres), targets.shape[1]))
    for places, some, learned, number in zip(kinds.values(), columns, metrics, rounds, strict=True):
        first.append(fit(points, learned[number].metric, some, learned[number].ridge, centres))
        predicted[:, places] = first[-1].in_parts
    inputs = LocalInputs(points[centres], predicted, centres, np.flatnonzero(np.isin(centres, choosing)))
    at_centres = [some[centres] for some in columns]
    local = [
        [fit_local(inputs, learned[0].metric, some, (places, given)) for given in _givens(kinds)]
        for places, some, learned in zip(kinds.values(), at_centres, metrics, strict=True)
    ]
    return Candidates(centres, at_centres, first, local)


def _givens(kinds: dict[str, list[int]]) -> list[list[int]]:
    """Return the sets of labels that slopes may depend on: how the object touches, and with its shear."""
    touch = [*kinds.get("depth", []), *kinds.get("tilt", [])]
    sheared = [*touch, *kinds.get("shear", [])]
    return [given for given in (touch, sheared if sheared != touch else []) if given]
