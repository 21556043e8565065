"""Places of lost beads, as their neighbours predict them."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.vision.neighbourhood import Neighbourhood

ROW = np.array([(0.0, 0.0), (10.0, 0.0), (20.0, 0.0), (40.0, 0.0)])


def test_a_lost_bead_moves_as_the_mean_of_its_neighbours_weighted_by_their_distance():
    moved = ROW + np.array([(3.0, 0.0), (99.0, 99.0), (0.0, 3.0), (0.0, 0.0)])
    found = np.array([True, False, True, True])
    weight = np.exp(-0.5 * np.array([1.0, 1.0, 3.0]) ** 2)  # one, one and three spacings away
    expected = ROW[1] + weight @ np.array([(3.0, 0.0), (0.0, 3.0), (0.0, 0.0)]) / weight.sum()
    assert Neighbourhood(ROW).predict(moved, found, np.array([1])) == pytest.approx(expected[None])


def test_a_lost_bead_far_from_all_others_moves_as_the_nearest_one():
    places = np.array([(0.0, 0.0), (1.0, 0.0), (60.0, 0.0), (61.0, 0.0)])
    moved = places + np.array([(9.0, 9.0), (2.0, 1.0), (0.0, 0.0), (0.0, 0.0)])
    found = np.array([True, True, False, False])  # exp(-59^2 / 2) is 0 in double precision
    predicted = Neighbourhood(places).predict(moved, found, np.array([2, 3]))
    assert predicted == pytest.approx(places[2:] + np.array([2.0, 1.0]))


def test_without_any_found_bead_the_places_are_the_untouched_ones():
    found = np.zeros(len(ROW), np.bool_)
    assert Neighbourhood(ROW).predict(ROW + 5.0, found, np.array([0, 3])).tolist() == ROW[[0, 3]].tolist()
