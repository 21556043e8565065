"""Means over found neighbours against NumPy's average."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.kernels.neighbourhood import NeighbourMeans

COUNT = 40
RANDOM = np.random.default_rng(0)
REST_PX, WEIGHT = RANDOM.uniform(0.0, 300.0, (COUNT, 2)), RANDOM.uniform(0.1, 1.0, (COUNT, COUNT))
MEANS = NeighbourMeans(REST_PX, WEIGHT, 1e-6)


@pytest.mark.parametrize("missing", [[], [7], [39, 0, 12], list(range(39))])
def test_places_are_weighted_means_of_the_found(missing):
    moved = RANDOM.normal(0.0, 5.0, REST_PX.shape)
    found = np.ones(COUNT, np.bool_)
    found[missing] = False
    place = REST_PX + np.where(found[:, None], moved, np.nan)
    expected = [REST_PX[bead] + np.average(moved, axis=0, weights=WEIGHT[bead] * found) for bead in missing]
    predicted = MEANS.predict(place, found, np.array(missing, np.intp))
    np.testing.assert_allclose(predicted, np.reshape(expected, (-1, 2)), atol=1e-9)


def test_too_little_weight_is_no_mean():
    assert MEANS.predict(REST_PX, np.zeros(COUNT, np.bool_), np.array([3])) is None
    faint = NeighbourMeans(REST_PX, np.full((COUNT, COUNT), 1e-9), 1e-6)
    assert faint.predict(REST_PX, np.ones(COUNT, np.bool_), np.array([3])) is None


@pytest.mark.parametrize("number", [-1, COUNT, 2**40])
def test_numbers_of_no_bead_are_refused(number):
    with pytest.raises(IndexError, match="not all of 40"):
        MEANS.predict(REST_PX, np.ones(COUNT, np.bool_), np.array([1, number]))


def test_places_without_a_value_end():
    place = np.full((COUNT, 2), np.nan)
    assert np.isnan(MEANS.predict(place, np.ones(COUNT, np.bool_), np.array([2]))).all()
