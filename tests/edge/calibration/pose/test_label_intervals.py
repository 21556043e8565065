"""Intervals of pose labels, on labels that are linear in the displacements, with noise of a known law."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from palpate_edge.calibration.pose.regression.kernel_regression import fit
from palpate_edge.calibration.pose.regression.label_regression import errors_of_choice, fit_labels
from palpate_edge.estimation.pose.kernel_expansion import ExpansionRunner, matern, packed
from palpate_edge.estimation.pose.label_runner import LabelRunner

NORMAL_95 = 1.96
LABELS = ("depth_mm", "torsion_deg")
DEPTH_NOISE_MM, TORSION_NOISE_DEG = 0.1, 1.0


def drawn_points(random, count):
    return random.uniform(-np.sqrt(3.0), np.sqrt(3.0), (count, 3))


def torsion_noise_deg(points):
    """Ten times as large at one end of the first coordinate as at the other."""
    return TORSION_NOISE_DEG * 10.0 ** (points[:, 0] / np.sqrt(12.0))


def half_widths(count, seed):
    """Half widths (2, f) at places from end to end, of labels fitted to so many presses, and those places."""
    random = np.random.default_rng(seed)
    points, noise = drawn_points(random, count), random.standard_normal((count, 2))
    depth_mm = points @ (1.0, 0.5, 0.2) + DEPTH_NOISE_MM * noise[:, 0]
    torsion_deg = 20.0 * points @ (0.1, 1.0, 0.5) + torsion_noise_deg(points) * noise[:, 1]
    fitted = fit_labels(points, np.ones(3), np.column_stack((depth_mm, torsion_deg)), LABELS)
    runner = ExpansionRunner(fitted.half_widths, points)
    places = np.column_stack((np.linspace(-1.5, 1.5, 31), np.zeros((31, 2))))
    return np.exp([runner.at(place.astype(np.float32)) for place in places]).T, places


def test_noise_that_is_the_same_everywhere_gives_one_half_width_of_its_size():
    """Errors that a press's own noise had leaked into gave 0.44 to 1.65 of it."""
    for seed in (0, 1):
        depth_mm, _ = half_widths(200, seed)[0]
        np.testing.assert_allclose(depth_mm, depth_mm[0], rtol=1e-6)
        assert depth_mm[0] == pytest.approx(NORMAL_95 * DEPTH_NOISE_MM, rel=0.2)


def test_noise_that_grows_with_the_displacement_gives_half_widths_that_follow():
    (_, torsion_deg), places = half_widths(400, 2)
    assert torsion_deg[-1] > 3.0 * torsion_deg[0]
    ratio = torsion_deg / (NORMAL_95 * torsion_noise_deg(places))
    assert np.median(ratio) == pytest.approx(1.0, abs=0.25)


def test_a_metric_that_is_hard_to_learn_does_not_make_half_widths_much_too_large():
    """The label hangs on weak coordinates, so that errors of presses the metric has not seen grow with the
    number of these: half widths of 400 presses judged by halves were 1.7 times the errors on fresh ones."""
    size, ratios = 2.0 ** (-np.arange(40) / 4), []
    for seed in range(3):
        random = np.random.default_rng(seed)
        drawn, noise = random.standard_normal((1400, 40)), random.standard_normal(1400)
        depth_mm = np.sin(drawn[:, 8:11] @ (1.0, 0.7, 0.5)) + 0.3 * drawn[:, 0] + 0.02 * noise
        points = drawn * size
        fitted = fit_labels(points[:400], size**2, depth_mm[:400, None], ("depth_mm",))
        runner = LabelRunner(
            SimpleNamespace(
                labels=("depth_mm",),
                centres=packed(points[:400]),
                groups=fitted.groups,
                local=fitted.local,
                networks=fitted.networks,
                correction=None,
                half_widths=fitted.half_widths,
            )
        )
        fresh = points[400:].astype(np.float32)
        error = np.abs([runner.at(point)[0] for point in fresh] - depth_mm[400:])
        half_width = np.median([runner.half_widths_at(point)[0] for point in fresh])
        ratios.append(half_width / np.quantile(error, 0.95))
    assert 0.9 < np.mean(ratios) < 1.45


def test_errors_of_a_choice_are_not_the_least_by_chance():
    """Candidates that are equally good have the same mean error, the one chosen has not less."""
    random = np.random.default_rng(4)
    of_all, of_least, of_choice = [], [], []
    for _ in range(200):
        errors = list(np.abs(random.standard_normal((6, 50, 1))))
        of_all.append(np.mean(errors))
        of_least.append(min(error.mean() for error in errors))
        of_choice.append(errors_of_choice(errors).mean())
    assert np.mean(of_least) < 0.9 * np.mean(of_all)
    assert np.mean(of_choice) == pytest.approx(np.mean(of_all), rel=0.05)


def test_errors_of_a_choice_are_those_of_a_candidate_that_is_better():
    errors = [np.full((30, 2), 2.0), np.ones((30, 2))]
    np.testing.assert_array_equal(errors_of_choice(errors), errors[1])


def test_predictions_in_parts_are_those_of_fits_without_that_part():
    """Against ridge regressions that are solved one by one."""
    random = np.random.default_rng(3)
    points = drawn_points(random, 57)
    targets = np.sin(points[:, :2]) + 0.1 * random.standard_normal((57, 2))
    fitted = fit(points, np.eye(3), targets, 0.05)
    gram = matern(np.square(points[:, None] - points).sum(axis=-1))
    offset = targets.mean(axis=0)

    def predicted(left_out):
        kept = np.setdiff1d(np.arange(57), left_out)
        system = gram[np.ix_(kept, kept)] + 0.05 * np.eye(len(kept))
        return gram[np.ix_(left_out, kept)] @ np.linalg.solve(system, targets[kept] - offset) + offset

    for part in range(10):
        there = np.arange(part, 57, 10)
        np.testing.assert_allclose(fitted.in_parts[there], predicted(there), atol=1e-9)
    np.testing.assert_allclose(fitted.left_out[[30]], predicted(np.array([30])), atol=1e-9)
