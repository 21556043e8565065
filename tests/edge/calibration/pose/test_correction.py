"""Corrections of a pose model's errors on another sensor, learned from few of its presses."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.calibration.pose.correction import MOST_TURNED, OwnCorrection, fit_correction
from palpate_edge.calibration.pose.label_vectors import LabelVector
from palpate_edge.common.arrays import Array
from palpate_edge.estimation.pose.kernel_expansion import matern
from palpate_edge.geometry.points import distances

TILT, SHEAR = (1, 2), (3, 4)  # places among the labels


def corrected(found: OwnCorrection, first: Array, points: Array, others: Array) -> Array:
    """Corrections (s, k) at points (s, m), learned at others (c, m)."""
    smooth = matern(distances(points @ found.metric, others @ found.metric) ** 2)
    return first @ found.trend + found.offset + smooth @ found.weights


def test_a_trend_with_the_models_labels_is_learned_from_ten_presses():
    """The first label is 0.8 too small and half of the second too large; the third only has noise."""
    random = np.random.default_rng(4)
    first, noise = random.normal(size=(210, 3)), 0.02 * random.normal(size=(210, 2))
    left = np.stack([0.8 - 0.5 * first[:, 1], np.zeros(210)], axis=1) + noise
    points = random.normal(size=(210, 5))
    found = fit_correction(points[:10], np.eye(5), first[:10], left[:10]).in_units(
        np.ones(3), np.array([1.0, 10.0])
    )
    error = left[10:] * [1, 10] - corrected(found, first[10:], points[10:], points[:10])
    assert np.abs(error).mean(axis=0) == pytest.approx([0, 0], abs=0.25)
    assert (np.abs(error) < found.half_width).mean() > 0.8


def vector_errors(sense: int, count: int, turned_sense: int | None) -> tuple[float, float]:
    """Errors of a tilt that is a fifth too large and turned by 6 deg, and takes up half of the shear across
    it: with that known to be alike in all directions, or not, and without a correction.

    sense: of the shear's axes, where those of the tilt are the image's.
    """
    random = np.random.default_rng(7)
    first, points = random.normal(size=(count + 400, 5)), random.normal(size=(count + 400, 6))
    tilt = first[:, TILT] @ (1, 1j)
    wrong = (0.2 * np.exp(0.1j) * tilt + 0.5j * (first[:, SHEAR] @ (1, sense * 1j)))[:, None]
    left = np.hstack([wrong.real, wrong.imag]) + 0.05 * random.normal(size=(count + 400, 2))
    vectors = [] if turned_sense is None else [LabelVector(TILT, 1), LabelVector(SHEAR, turned_sense)]
    found = fit_correction(
        points[:count], np.eye(6), first[:count], left[:count], vectors[0] if vectors else None, vectors
    )
    error = left[count:] - corrected(found, first[count:], points[count:], points[:count])
    return float(np.abs(error).mean()), float(np.abs(left[count:]).mean())


@pytest.mark.parametrize("sense", [1, -1])
def test_a_vector_is_wrong_alike_in_all_directions(sense: int) -> None:
    """Five presses show two complex coefficients, but not ten real ones."""
    error, uncorrected = vector_errors(sense, 5, sense)
    apart, _ = vector_errors(sense, 5, None)
    assert error < 0.5 * apart < 0.5 * uncorrected


@pytest.mark.parametrize("turned_sense", [0, -1])
def test_vectors_of_unknown_or_wrong_sense_are_no_worse_than_labels_of_their_own(turned_sense: int) -> None:
    error, _ = vector_errors(1, 12, turned_sense)
    apart, _ = vector_errors(1, 12, None)
    assert error < 1.1 * apart


def test_many_presses_show_the_trend_of_each_label() -> None:
    several, _ = vector_errors(1, MOST_TURNED + 1, 1)
    assert several == vector_errors(1, MOST_TURNED + 1, None)[0]
    assert several < 0.06


def test_a_mirrored_vector_turns_the_other_way() -> None:
    labels = np.array([[7.0, 1.0, 2.0]])
    assert LabelVector((1, 2), 1).in_image(labels).tolist() == [1 + 2j]
    assert LabelVector((0, 1), -1).moved_to(1).in_image(labels).tolist() == [1 - 2j]
