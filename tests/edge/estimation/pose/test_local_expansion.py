"""Local expansions: values worked out by hand, and fits of labels whose slope depends on the pose."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.calibration.pose.regression.local_regression import LocalInputs, fit_local
from palpate_edge.estimation.pose.kernel_expansion import packed
from palpate_edge.estimation.pose.local_expansion import LocalExpansion, LocalExpansionRunner


def test_a_centre_counts_by_its_pose_and_by_the_product_of_the_points():
    """Pose 2 away: 0.139731; points 3 and 2: 1 + 6; weight 10, offset 1."""
    expansion = LocalExpansion(
        labels=(1,),
        given=(0,),
        scale=packed(np.array([0.5])),
        poses=packed(np.array([[1.0]])),
        centres=(1,),
        metric=packed(np.eye(1)),
        weights=packed(np.array([[10.0]])),
        offset=packed(np.array([1.0])),
    )
    runner = LocalExpansionRunner(expansion, np.array([[9.0], [2.0]]))
    point, near = np.array([3.0], np.float32), runner.nearness(np.array([6.0, 77.0]))
    got = runner.at(point, near)
    assert got == pytest.approx([1 + 10 * 7 * 0.139731], rel=1e-4)
    half = LocalExpansionRunner(expansion.over(2), np.array([[9.0], [2.0]]))
    assert half.has_nearness_of(runner)
    assert half.at(point, near) == pytest.approx(got / 2, rel=1e-5)


def test_a_slope_that_depends_on_the_pose_is_learned():
    """Torsion is a displacement over depth here; a plane alone leaves a third of it."""
    random = np.random.default_rng(2)
    depth, torsion = random.uniform(1, 4, 300), random.uniform(-5, 5, 300)
    points = np.stack([depth * torsion, random.normal(size=300)], axis=1)
    first = np.stack([depth, np.zeros(300)], axis=1)
    train = np.arange(200)
    inputs = LocalInputs(points[train], first[train], centres=train, choosing=train)
    fitted = fit_local(inputs, np.eye(2), torsion[train, None], ([1], [0]))
    runner = LocalExpansionRunner(fitted.expansion, points)
    new = [runner.at(points[n].astype(np.float32), runner.nearness(first[n]))[0] for n in range(200, 300)]
    assert np.abs(new - torsion[200:]).mean() < 0.05
    assert np.abs(fitted.left_out[:, 0] - torsion[train]).mean() < 0.05
