"""Nearest blobs in a grid of cells, for places and blobs anywhere."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from palpate_edge.kernels.nearest_blob import NO_BLOB, BlobGrid

COORDINATE = st.one_of(st.floats(-1000.0, 1000.0), st.floats(allow_nan=True, allow_infinity=True))
PLACES = st.lists(st.tuples(COORDINATE, COORDINATE), max_size=40)


def grid_of(blob_px):
    grid = BlobGrid()
    grid.load(blob_px)
    return grid


@pytest.mark.parametrize("count", [1, 2, 30, 3000])
@pytest.mark.parametrize("stretch", [(1.0, 1.0), (100.0, 0.01), (0.0, 1.0)])
def test_the_nearest_is_that_of_a_k_d_tree(count, stretch):
    random = np.random.default_rng(count)
    blobs, places = random.normal(0.0, 100.0, (count, 2)) * stretch, random.normal(0.0, 300.0, (200, 2))
    blob, squared = grid_of(blobs).look_up(places)
    distance, nearest = cKDTree(blobs).query(places)
    np.testing.assert_array_equal(blob, nearest)
    np.testing.assert_allclose(squared, distance**2)


def test_a_grid_takes_frames_with_more_and_with_fewer_blobs():
    grid, place = BlobGrid(), np.array([[3.0, 4.0]])
    for count in (5, 50, 1):
        grid.load(np.stack([10.0 * np.arange(count), np.zeros(count)], axis=1))
        assert grid.look_up(place)[0].tolist() == [0]
    grid.load(np.empty((0, 2)))
    assert grid.look_up(place)[0].tolist() == [NO_BLOB]
    assert grid.assign(place, np.array([100.0])).tolist() == [NO_BLOB]


def test_places_beside_blobs_of_their_own_get_the_assignment_of_least_distance():
    random = np.random.default_rng(2)
    blobs = 20.0 * np.stack(np.meshgrid(np.arange(12.0), np.arange(12.0)), axis=-1).reshape(-1, 2)
    places = random.permutation(blobs)[:100] + random.uniform(-6.0, 6.0, (100, 2))
    cost = ((places[:, None] - blobs[None]) ** 2).sum(axis=2)
    np.testing.assert_array_equal(
        grid_of(blobs).assign(places, np.full(100, 81.0)), linear_sum_assignment(cost)[1]
    )


def test_blobs_a_fiftieth_of_a_pixel_apart_are_told_apart_far_from_the_origin() -> None:
    blobs = np.array([[2000.0, 1500.0], [2010.0, 1500.0]])
    at = np.array([[2004.98, 1500.0], [2005.02, 1500.0]])
    assert grid_of(blobs).look_up(at)[0].tolist() == [0, 1]


@pytest.mark.parametrize("others", [1, 2, 5])
def test_a_blob_that_several_places_want_goes_to_the_nearest(others: int) -> None:
    blobs = np.array([[10.0, 10.0], [50.0, 10.0]])
    places = np.array([*([10.0 + 2.0 * (k + 1), 10.0] for k in range(others)), [10.5, 10.0], [50.0, 11.0]])
    for order in (np.arange(len(places)), np.arange(len(places))[::-1]):
        found = grid_of(blobs).assign(places[order], np.full(len(places), 400.0))
        expected = np.full(len(places), NO_BLOB)
        expected[others:] = [0, 1]
        np.testing.assert_array_equal(found, expected[order])


def test_a_blob_at_the_gate_is_out_of_it() -> None:
    blobs, places = np.array([[0.0, 0.0], [10.0, 0.0]]), np.array([[3.0, 0.0], [13.0, 0.0]])
    assert grid_of(blobs).assign(places, np.array([9.0, 9.01])).tolist() == [NO_BLOB, 1]
    assert grid_of(blobs).assign(places, np.zeros(2)).tolist() == [NO_BLOB, NO_BLOB]


@given(PLACES, PLACES)
@settings(max_examples=300, deadline=None)
def test_any_numbers_give_a_blob_or_none(blobs, places):
    blob_px, place_px = np.array(blobs).reshape(-1, 2), np.array(places).reshape(-1, 2)
    grid = grid_of(blob_px)
    for blob in (grid.look_up(place_px)[0], grid.assign(place_px, np.full(len(place_px), 1e5))):
        assert ((blob >= NO_BLOB) & (blob < len(blob_px))).all()
    given_away = blob[blob != NO_BLOB]
    assert len(np.unique(given_away)) == len(given_away)
