"""Fewer centres: the pivots against scipy's pivoted Cholesky, the smaller sum against the whole one."""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dpstrf

from palpate_edge.calibration.training.compress import compressed, pivoted_cholesky
from palpate_edge.calibration.training.gaussian_kernel import gaussian_kernel


def points(count=120, seed=3):
    return np.random.default_rng(seed).uniform(-1, 1, (count, 3))


def kernel(a, b):
    return gaussian_kernel(a, b, 1.5)


def test_the_pivots_and_the_factor_are_lapacks():
    place = points()
    matrix = kernel(place, place)
    pivots, factor = pivoted_cholesky(place, kernel, 25)
    whole, order, _, _ = dpstrf(matrix, lower=1)
    assert pivots.tolist() == (order[:25] - 1).tolist()
    lapacks = np.tril(whole)[:, :25]
    assert np.allclose(factor[order - 1], lapacks, atol=1e-8)


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
