"""Means over found neighbours against NumPy's average."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.kernels.neighbourhood import NeighbourMeans

COUNT = 40
RANDOM = np.random.default_rng(0)
REST_PX, APART = RANDOM.uniform(0.0, 300.0, (COUNT, 2)), RANDOM.uniform(0.0, 2.0, (COUNT, COUNT))
WEIGHT = np.exp(-0.5 * APART**2)
MEANS = NeighbourMeans(REST_PX, APART, 1e-6)


@pytest.mark.parametrize("missing", [[], [7], [39, 0, 12], list(range(39))])
def test_places_are_weighted_means_of_the_found(missing):
    moved = RANDOM.normal(0.0, 5.0, REST_PX.shape)
    found = np.ones(COUNT, np.bool_)
    found[missing] = False
    place = REST_PX + np.where(found[:, None], moved, np.nan)
    expected = [REST_PX[bead] + np.average(moved, axis=0, weights=WEIGHT[bead] * found) for bead in missing]
    predicted = MEANS.predict(place, found, np.array(missing, np.intp))
    np.testing.assert_allclose(predicted, np.reshape(expected, (-1, 2)), atol=1e-9)


def test_without_a_found_bead_places_are_the_untouched_ones():
    found = np.zeros(COUNT, np.bool_)
    assert MEANS.predict(REST_PX + 5.0, found, np.array([3])).tolist() == REST_PX[[3]].tolist()


@pytest.mark.parametrize("farther", [10.0, 60.0])
def test_far_neighbours_count_by_how_much_nearer_they_are(farther):
    """exp(-d^2 / 2) of 60 is 0 in double precision; logarithms of the weights are subtracted first."""
    moved = RANDOM.normal(0.0, 5.0, REST_PX.shape)
    far = np.sqrt(farther**2 + APART**2)
    logarithm = -0.5 * far[3] ** 2
    weight = np.exp(logarithm - logarithm.max())
    predicted = NeighbourMeans(REST_PX, far, 1e-6).predict(
        REST_PX + moved, np.ones(COUNT, np.bool_), np.array([3])
    )
    expected = REST_PX[3] + np.average(moved, axis=0, weights=weight)
    np.testing.assert_allclose(predicted[0], expected, atol=1e-5)


@pytest.mark.parametrize("number", [-1, COUNT, 2**40])
def test_numbers_of_no_bead_are_refused(number):
    with pytest.raises(IndexError, match="not all of 40"):
        MEANS.predict(REST_PX, np.ones(COUNT, np.bool_), np.array([1, number]))


def test_places_without_a_value_end():
    place = np.full((COUNT, 2), np.nan)
    assert np.isnan(MEANS.predict(place, np.ones(COUNT, np.bool_), np.array([2]))).all()
