"""Fewer centres: pivots against sums that are solved for, the factor against LAPACK's, fewer against all."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

from palpate_edge.calibration.training.compress import compressed, greedy_pivots
from palpate_edge.calibration.training.gaussian_kernel import gaussian_kernel


def points(count=120, seed=3):
    return np.random.default_rng(seed).uniform(-1, 1, (count, 3))


def kernel(a, b):
    return gaussian_kernel(a, b, 1.5)


def test_each_pivot_is_where_the_sum_about_those_before_misses_by_most():
    place = points()
    values = np.stack([np.sin(4 * place[:, 0]), place[:, 1] * place[:, 2]], axis=1)
    pivots, _ = greedy_pivots(place, values, kernel, 12)
    for number, pivot in enumerate(pivots):
        before = place[pivots[:number]]
        weights = np.linalg.solve(kernel(before, before), values[pivots[:number]])
        missed = np.linalg.norm(values - kernel(place, before) @ weights, axis=1)
        assert missed[pivot] == pytest.approx(missed.max())


def test_the_factor_is_lapacks_in_the_order_of_the_pivots():
    place = points()
    pivots, factor = greedy_pivots(place, np.sin(4 * place[:, :1]), kernel, 25)
    chosen = place[pivots]
    assert np.allclose(factor[pivots], scipy.linalg.cholesky(kernel(chosen, chosen), lower=True), atol=1e-8)
    assert np.allclose(factor @ factor[pivots].T, kernel(place, chosen), atol=1e-8)


def test_values_in_small_units_are_met_as_well():
    """Two unlike values of which one is written in a unit 1000 times as large."""
    place = points(300)
    values = np.stack([np.sin(5 * place[:, 0]), np.sin(5 * place[:, 1])], axis=1)
    same = compressed(place, values, kernel, 40, np.ones(300))
    units = np.array([1.0, 1e-3])
    centres, weights = compressed(place, values * units, kernel, 40, np.ones(300), units)
    assert np.array_equal(centres, same[0])
    assert np.allclose(weights, same[1] * units, rtol=1e-4, atol=1e-9)


def test_a_fifth_of_the_centres_says_what_all_say():
    place = points(300)
    values = np.stack([np.sin(place.sum(axis=1)), place[:, 0] * place[:, 1]], axis=1)
    weights = np.linalg.solve(kernel(place, place) + 1e-6 * np.eye(300), values)
    centres, fewer = compressed(place, kernel(place, place) @ weights, kernel, 60, np.ones(300))
    assert centres.shape == (60, 3)
    between = points(200, seed=4) * 0.9
    off = kernel(between, centres) @ fewer - kernel(between, place) @ weights
    assert np.abs(off).max() < 1e-2


def test_important_points_are_met_better():
    place = points(200)
    rough = np.sign(np.sin(9 * place[:, :1]))  # more than 20 centres can say
    importance = np.where(np.arange(200) < 100, 1.0, 10.0)
    errors = []
    for weight in (np.ones(200), importance):
        centres, weights = compressed(place, rough, kernel, 20, weight)
        errors.append(np.abs(kernel(place, centres) @ weights - rough)[100:].mean())
    assert errors[1] < errors[0]


def test_points_that_say_the_same_need_one_centre():
    twice = np.repeat(points(10), 5, axis=0)
    centres, _ = compressed(twice, np.ones((50, 1)), kernel, 40, np.ones(50))
    assert len(centres) == 10
