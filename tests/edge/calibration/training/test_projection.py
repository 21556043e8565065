"""The metric of the kernels: what matters counts, what does not hardly counts."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.calibration.training.gaussian_kernel import gaussian_kernel, gradient_product
from palpate_edge.calibration.training.projection import fit_projection

WIDTH = 12


def test_the_gradients_are_those_of_finite_differences():
    rng = np.random.default_rng(0)
    points, weights, step = rng.standard_normal((20, 3)), rng.standard_normal((20, 2)), 1e-5
    slopes = [
        (
            gaussian_kernel(points + step * axis, points, 1.0) @ weights
            - gaussian_kernel(points - step * axis, points, 1.0) @ weights
        )
        / (2 * step)
        for axis in np.eye(3)
    ]
    expected = np.einsum("ank,bnk->ab", slopes, slopes) / len(points)
    np.testing.assert_allclose(gradient_product(points, weights), expected, rtol=1e-5, atol=1e-8)


@pytest.fixture(scope="module")
def presses():
    """Fields of a large part that changes nothing and a small one that is the answer, and the answers."""
    rng = np.random.default_rng(1)
    base, large, small = np.linalg.qr(rng.standard_normal((WIDTH, 3)))[0].T
    idle, answer = rng.standard_normal((2, 300))
    return base + 0.3 * idle[:, None] * large + 0.05 * answer[:, None] * small, answer, (base, large, small)


def distances(projection, of):
    """The points' distance for one deviation of the idle part, and of the answer."""
    base, large, small = of
    near, far, answer = projection.points(np.array([base, base + 0.3 * large, base + 0.05 * small]))
    return np.linalg.norm(far - near), np.linalg.norm(answer - near)


def test_a_small_part_that_is_the_answer_counts_more_than_a_large_idle_one(presses):
    fields, answer, of = presses
    idle, told = distances(fit_projection(fields, fields, answer[:, None]), of)
    plain_idle, plain_told = distances(fit_projection(fields, None, None), of)
    assert plain_told < 0.3 * plain_idle
    assert told > 3 * (plain_told / plain_idle) * idle


def test_points_have_the_mean_square_one(presses):
    fields, answer, _ = presses
    for learned_from in ((None, None), (fields, answer[:, None])):
        points = fit_projection(fields, *learned_from).points(fields)
        assert ((points - points.mean(axis=0)) ** 2).sum(axis=1).mean() == pytest.approx(1)
