"""The local warp against weighted least squares, solved bead by bead."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.vision.local_warp import GRADIENT_RIDGE, LENGTH, NEAREST, REACH, LocalWarp
from palpate_edge.vision.neighbourhood import Neighbourhood

RANDOM = np.random.default_rng(3)
REST = 30.0 * np.stack(np.meshgrid(np.arange(9.0), np.arange(8.0)), axis=-1).reshape(-1, 2)
REST += RANDOM.normal(0.0, 2.0, REST.shape)
DISPLACEMENT = RANDOM.normal(0.0, 5.0, REST.shape)


def least_squares(displacement_px, known):
    """Fit shift and gradient about each bead to its known neighbours; the ridge is on the gradient."""
    apart = np.linalg.norm(REST[:, None] - REST[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    spacing = np.sort(apart, axis=1)[:, :NEAREST].mean(axis=1)
    unit = np.median(spacing)
    predicted = []
    for bead, place in enumerate(REST):
        relative = apart[bead] / spacing[bead]
        weight = known * np.where(relative < REACH, np.exp(-0.5 * (relative / LENGTH) ** 2), 0.0)
        weight /= weight.sum()
        mean = weight @ REST
        design = np.column_stack([np.ones(len(REST)), (REST - mean) / unit])
        normal = design.T @ (weight[:, None] * design) + np.diag([0.0, GRADIENT_RIDGE, GRADIENT_RIDGE])
        fitted = np.linalg.solve(normal, design.T @ (weight[:, None] * displacement_px))
        predicted.append(np.array([1.0, *((place - mean) / unit)]) @ fitted)
    return np.array(predicted)


@pytest.mark.parametrize("hidden", [(), (0,), (3, 20, 21, 40)])
def test_predictions_are_those_of_weighted_least_squares(hidden):
    known = np.ones(len(REST), dtype=np.bool_)
    known[list(hidden)] = False
    predicted, support = LocalWarp(Neighbourhood(REST)).predict(DISPLACEMENT, known)
    assert predicted == pytest.approx(least_squares(DISPLACEMENT, known), abs=1e-3)
    assert support.max() == pytest.approx(1.0, abs=1e-5)
    assert (support < 1.0 - 1e-3).any() == bool(hidden)
