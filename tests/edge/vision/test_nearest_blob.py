"""The nearest blob against scipy's k-d tree, and who gets a blob that several places want."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from palpate_edge.vision.nearest_blob import NO_BLOB, NearestBlob


@pytest.mark.parametrize("seed", range(3))
def test_the_nearest_blob_is_that_of_a_k_d_tree(seed: int) -> None:
    random = np.random.default_rng(seed)
    blobs, places = random.uniform(0.0, 640.0, (200, 2)), random.uniform(-20.0, 660.0, (300, 2))
    blob, squared = NearestBlob(blobs).look_up(places)
    distance, nearest = cKDTree(blobs).query(places)
    np.testing.assert_array_equal(blob, nearest)
    np.testing.assert_allclose(squared, distance**2, rtol=1e-9)


def test_blobs_a_fiftieth_of_a_pixel_apart_are_told_apart_far_from_the_origin() -> None:
    blobs = np.array([[2000.0, 1500.0], [2010.0, 1500.0]])
    at = np.array([[2004.98, 1500.0], [2005.02, 1500.0]])
    assert NearestBlob(blobs).look_up(at)[0].tolist() == [0, 1]


@pytest.mark.parametrize("others", [1, 2, 5])
def test_a_blob_that_several_places_want_goes_to_the_nearest(others: int) -> None:
    blobs = np.array([[10.0, 10.0], [50.0, 10.0]])
    places = np.array([*([10.0 + 2.0 * (k + 1), 10.0] for k in range(others)), [10.5, 10.0], [50.0, 11.0]])
    for order in (np.arange(len(places)), np.arange(len(places))[::-1]):
        found = NearestBlob(blobs).assign(places[order], np.full(len(places), 400.0))
        expected = np.full(len(places), NO_BLOB)
        expected[others:] = [0, 1]
        np.testing.assert_array_equal(found, expected[order])


def test_a_blob_at_the_gate_is_out_of_it() -> None:
    blobs, places = np.array([[0.0, 0.0], [10.0, 0.0]]), np.array([[3.0, 0.0], [13.0, 0.0]])
    assert NearestBlob(blobs).assign(places, np.array([9.0, 9.01])).tolist() == [NO_BLOB, 1]
    assert NearestBlob(blobs).assign(places, np.zeros(2)).tolist() == [NO_BLOB, NO_BLOB]
