"""Stiffness by place, learned from the forces of presses left out in turn.

No wall is equally stiff everywhere, and the correction model cannot know where it is stiff: in the canonical
frame all azimuths are alike. The logarithm of a press's force over the one that the model gives it, left out,
is taken for a Gaussian process over the dome, and so is the force along the surface that is left (slant.py).
How much they vary does not follow from twenty presses. Therefore all settings count by how probable they make
the presses (their evidence), an even wall among them. Each is used where it brings the forces of presses left
out nearer to the truth.

A model that was fitted to forces of an uneven wall has taken them for shapes of fields. It is therefore
fitted again to forces of an even wall, and the stiffness to what that leaves, in turn (backfitting: Hastie,
Tibshirani, Friedman, The Elements of Statistical Learning, 2009, section 9.1). The dome model, which knows no
press of the sensor, shows the first wall.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from palpate_edge.calibration.evidence import mean_by_evidence
from palpate_edge.calibration.training.gaussian_kernel import gaussian_kernel
from palpate_edge.calibration.training.kernel_ridge import Regression
from palpate_edge.calibration.training.left_out import LeftOut, force_misses_N, mean_miss_N
from palpate_edge.calibration.training.samples import Samples, TrainingPress
from palpate_edge.calibration.training.slant import along, frames_in_sensor, missing_slants, slanted
from palpate_edge.calibration.training.uncertainty.interval import Interval, fit_interval
from palpate_edge.common.arrays import Array
from palpate_edge.estimation.contact_fit.place_stiffness import PlaceStiffness, StiffnessMap
from palpate_edge.estimation.pose.kernel_expansion import Expansion, packed

LENGTHS = (0.35, 0.6, 1.0, 1.6)  # of the kernel, chord on the unit sphere
AMPLITUDES = (0.0, 0.03, 0.06, 0.1, 0.15)  # standard deviation of the stiffness over the dome
NOISES = (0.02, 0.04, 0.08, 0.15)  # of a firm press
COMMON = 0.03  # standard deviation of what all presses share
MOST_FAINTNESS = 10.0  # the noise of a press is that of a firm one times its faintness
LARGEST_RATIO = 2.0  # of a press; more is no stiffness
# Shares of the misses of left-out forces: by slants and by the stiffness before a refit; and of the dome
# model's forces, where even walls reach 0.11.
LEAST_GAIN, LEAST_DOME_GAIN = 0.05, 0.15
MOST_REFITS = 2


@dataclass(frozen=True, slots=True)
class FittedStiffness:
    """stiffness: for the calibration file; force95: 95 % half width of forces with it; miss_N: mean distance
    of left-out presses' forces with it from the true ones; gain: the share of the misses without it that it
    takes away."""

    stiffness: PlaceStiffness
    force95: Interval | None
    miss_N: float
    gain: float


@dataclass(frozen=True, slots=True)
class _Mean:
    """Mean weights (c, k) and offset (k,) of one length, what is left (c, k) of each press by the others, and
    the logarithm of the evidence."""

    length: float
    weights: Array
    offset: Array
    left_over: Array
    log_evidence: float

    def expansion(self) -> Expansion:
        """Return the mean for the calibration file."""
        return Expansion(packed(np.eye(3) / self.length), packed(self.weights), packed(self.offset))


def refit_evenly(
    model: Regression,
    presses: Sequence[TrainingPress],
    refit: Callable[[Sequence[TrainingPress]], Regression],
) -> tuple[Regression, FittedStiffness | None]:
    """Return the model of the presses, fitted again where the wall is uneven, and the stiffness by place.

    It is None without presses of known force and where it does not improve their forces.
    """
    left_out = model.left_out
    if left_out is None or any(press.force_N is None for press in presses):
        return model, None

    def without(wall: FittedStiffness) -> tuple[Regression, FittedStiffness | None]:
        again = refit(evened(presses, wall.stiffness))
        assert again.left_out is not None
        return again, fit_place_stiffness(replace(again.left_out, samples=left_out.samples), presses)

    best = fit_place_stiffness(left_out, presses)
    miss_N = mean_miss_N(left_out.forces_N, left_out.samples) if best is None else best.miss_N
    wall = None
    if left_out.dome_N is not None:
        wall = fit_place_stiffness(replace(left_out, forces_N=left_out.dome_N), presses)
    if wall is not None and wall.gain >= LEAST_DOME_GAIN:
        again, found = without(wall)
        if found is not None and found.miss_N < (1 - LEAST_GAIN) * miss_N:
            model, best = again, found
    for _ in range(MOST_REFITS):
        if best is None or best.gain < LEAST_GAIN:
            break
        again, found = without(best)
        if found is None or found.miss_N >= best.miss_N:
            break
        model, best = again, found
    return model, best


def evened(presses: Sequence[TrainingPress], stiffness: PlaceStiffness) -> list[TrainingPress]:
    """Return the presses with the forces that they would have on the wall of the correction model."""
    wall, even = StiffnessMap(stiffness), []
    for press in presses:
        force_N = np.asarray(press.force_N)
        x, y, z = press.direction.tolist()
        slant_N = np.linalg.norm(force_N) * np.array(wall.slant((x, y, z)))
        even.append(replace(press, force_N=(force_N - slant_N) / wall.ratio((x, y, z))))
    return even


def fit_place_stiffness(left_out: LeftOut, presses: Sequence[TrainingPress]) -> FittedStiffness | None:
    """Fit to the presses (c,) that were left out; None where the stiffness does not improve their forces."""
    samples, given_N = left_out.samples, left_out.forces_N
    places = np.array([press.direction for press in presses])
    noise = np.minimum([press.faintness for press in presses], MOST_FAINTNESS)
    log_ratio = _log_ratios(given_N, samples, len(presses))
    frames = frames_in_sensor(samples, presses)
    own_N = given_N * np.exp(log_ratio)[samples.press, None]
    slants = missing_slants(own_N, samples, presses, frames)
    ratio, slant = _most_probable(places, (log_ratio[:, None], slants), noise)

    scaled_N = given_N * np.exp(log_ratio[:, None] - ratio.left_over)[samples.press]
    added = along(slants - slant.left_over, places)[samples.press]
    even_miss_N, miss_N = mean_miss_N(given_N, samples), mean_miss_N(scaled_N, samples)
    if miss_N >= even_miss_N:
        return None
    stiffness, found_N = PlaceStiffness(packed(places), ratio.expansion()), scaled_N
    slanted_N = slanted(scaled_N, added, frames)
    if mean_miss_N(slanted_N, samples) < (1 - LEAST_GAIN) * miss_N:
        stiffness, found_N = msgspec.structs.replace(stiffness, slant=slant.expansion()), slanted_N
        miss_N = mean_miss_N(slanted_N, samples)
    force95 = fit_interval(force_misses_N(found_N, samples), samples)
    return FittedStiffness(stiffness, force95, miss_N, 1 - miss_N / even_miss_N)


def _log_ratios(given_N: Array, samples: Samples, count: int) -> Array:
    """Return the logarithm (c,) of each press's force over the given ones (s, 3) of its plain samples, by
    least squares."""
    products, squares = (
        np.bincount(samples.press[samples.plain], np.vecdot(given_N, other_N)[samples.plain], minlength=count)
        for other_N in (samples.forces_N, given_N)
    )
    ratio = products / np.maximum(squares, 1e-12)
    return np.log(np.clip(ratio, 1.0 / LARGEST_RATIO, LARGEST_RATIO))


def _most_probable(places: Array, values: Sequence[Array], noise: Array) -> list[_Mean]:
    """Return the fit to each of the values (c, k) with the length whose evidence is the largest."""
    fits = [_posteriors(length, gaussian_kernel(places, places, length), values, noise) for length in LENGTHS]
    return [max(each, key=lambda one: one.log_evidence) for each in zip(*fits, strict=True)]


def _posteriors(length: float, smooth: Array, values: Sequence[Array], noise: Array) -> list[_Mean]:
    """Return the mean of each of the values (c, k) over amplitudes and noises, by their evidence.

    smooth (c, c): the kernel of this length between the presses.
    """
    logs: list[list[float]] = [[] for _ in values]
    found: list[list[tuple[Array, ...]]] = [[] for _ in values]
    for amplitude, level in itertools.product(AMPLITUDES, NOISES):
        covariance = amplitude**2 * smooth + COMMON**2 + np.diag((level * noise) ** 2)
        inverse = np.linalg.inv(covariance)
        log_determinant = float(np.linalg.slogdet(inverse)[1])
        for number, each in enumerate(values):
            pull = inverse @ each
            logs[number].append(0.5 * (each.shape[1] * log_determinant - float((each * pull).sum())))
            left_over = pull / inverse.diagonal()[:, None]
            found[number].append((amplitude**2 * pull, COMMON**2 * pull.sum(axis=0), left_over))
    posteriors = []
    for each_logs, each_found in zip(logs, found, strict=True):
        (weights, offset, left_over), log_evidence = mean_by_evidence(each_logs, each_found)
        posteriors.append(_Mean(length, weights, offset, left_over, log_evidence))
    return posteriors
