"""Stiffness by place, learned from the forces of presses left out in turn.

No wall is equally stiff everywhere, and the correction model cannot know where it is stiff: in the canonical
frame all azimuths are alike. The logarithm of a press's force over the one that the model gives it, left out,
is taken for a Gaussian process over the dome. How much the stiffness varies does not follow from twenty
presses. Therefore all settings count by how probable they make the presses (their evidence), an even wall
among them. The result is used where it brings the forces of presses left out nearer to the truth.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate_edge.calibration.evidence import mean_by_evidence
from palpate_edge.calibration.training.gaussian_kernel import gaussian_kernel
from palpate_edge.calibration.training.left_out import LeftOut, force_misses_N
from palpate_edge.calibration.training.samples import Samples, TrainingPress
from palpate_edge.calibration.training.uncertainty.interval import Interval, fit_interval
from palpate_edge.common.arrays import Array
from palpate_edge.estimation.contact_fit.place_stiffness import PlaceStiffness
from palpate_edge.estimation.pose.kernel_expansion import Expansion, packed

LENGTHS = (0.35, 0.6, 1.0, 1.6)  # of the kernel, chord on the unit sphere
AMPLITUDES = (0.0, 0.03, 0.06, 0.1, 0.15)  # standard deviation of the stiffness over the dome
NOISES = (0.02, 0.04, 0.08, 0.15)  # of a firm press
COMMON = 0.03  # standard deviation of what all presses share
MOST_FAINTNESS = 10.0  # the noise of a press is that of a firm one times its faintness
LARGEST_RATIO = 2.0  # of a press; more is no stiffness


@dataclass(frozen=True, slots=True)
class FittedStiffness:
    """stiffness: for the calibration file; force95: 95 % half width of forces with it."""

    stiffness: PlaceStiffness
    force95: Interval | None


@dataclass(frozen=True, slots=True)
class _MeanStiffness:
    """Mean weights (c,) and offset of one length, what is left (c,) of each press by the others, and the
    logarithm of the evidence."""

    weights: Array
    offset: float
    left_over: Array
    log_evidence: float


def fit_place_stiffness(left_out: LeftOut, presses: Sequence[TrainingPress]) -> FittedStiffness | None:
    """Fit to the presses (c,) that were left out; None where the stiffness does not improve their forces."""
    samples = left_out.samples
    log_ratio = _log_ratios(left_out.forces_N, samples, len(presses))
    places = np.array([press.direction for press in presses])
    noise = np.minimum([press.faintness for press in presses], MOST_FAINTNESS)
    found = [
        (length, _posterior(gaussian_kernel(places, places, length), log_ratio, noise)) for length in LENGTHS
    ]
    length, best = max(found, key=lambda one: one[1].log_evidence)
    ratio = np.exp(log_ratio - best.left_over)[samples.press, None]
    after_N = force_misses_N(ratio * left_out.forces_N, samples)
    if after_N[samples.plain].mean() >= force_misses_N(left_out.forces_N, samples)[samples.plain].mean():
        return None
    expansion = Expansion(
        packed(np.eye(3) / length), packed(best.weights[:, None]), packed(np.array([best.offset]))
    )
    return FittedStiffness(PlaceStiffness(packed(places), expansion), fit_interval(after_N, samples))


def _log_ratios(given_N: Array, samples: Samples, count: int) -> Array:
    """Return the logarithm (c,) of each press's force over the given ones (s, 3) of its plain samples, by
    least squares."""
    products, squares = (
        np.bincount(samples.press[samples.plain], np.vecdot(given_N, other_N)[samples.plain], minlength=count)
        for other_N in (samples.forces_N, given_N)
    )
    ratio = products / np.maximum(squares, 1e-12)
    return np.log(np.clip(ratio, 1.0 / LARGEST_RATIO, LARGEST_RATIO))


def _posterior(smooth: Array, log_ratio: Array, noise: Array) -> _MeanStiffness:
    """Return the mean over amplitudes and noises with one kernel (c, c), by their evidence."""
    logs, found = [], []
    for amplitude, level in itertools.product(AMPLITUDES, NOISES):
        covariance = amplitude**2 * smooth + COMMON**2 + np.diag((level * noise) ** 2)
        inverse = np.linalg.inv(covariance)
        pull = inverse @ log_ratio
        logs.append(0.5 * float(np.linalg.slogdet(inverse)[1] - log_ratio @ pull))
        found.append((amplitude**2 * pull, COMMON**2 * pull.sum(), pull / inverse.diagonal()))
    (weights, offset, left_over), log_evidence = mean_by_evidence(logs, found)
    return _MeanStiffness(weights, float(offset), left_over, log_evidence)
