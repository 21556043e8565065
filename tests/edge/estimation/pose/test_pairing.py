"""Pairing spots with markers: right where places are expected, and none where there is no spot."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.estimation.pose.marker_density import MarkerDensity
from palpate_edge.estimation.pose.pairing import Pairing
from palpate_edge.vision.blob_detection import Blobs

COLUMN, ROW = np.meshgrid(np.arange(9), np.arange(9))
REST = 20.0 * np.stack([COLUMN.ravel(), ROW.ravel()], axis=1) + 50.0
PAIRING = Pairing(REST)


def spots(places_px):
    return Blobs(places_px, np.full(len(places_px), 100.0))


def stretched(factor):
    """Displaced by up to 0.8 of the spacing at the rim."""
    centre = REST.mean(axis=0)
    return centre + factor * (REST - centre)


def test_markers_that_moved_by_more_than_half_their_spacing_keep_their_numbers():
    random = np.random.default_rng(3)
    order = random.permutation(len(REST))
    true_px = stretched(1.2)
    assert np.linalg.norm(true_px - REST, axis=1).max() > 20.0
    expected_px = true_px + random.normal(0, 1.0, REST.shape)
    paired = PAIRING.match(expected_px, spots(true_px[order]))
    assert paired.found.all()
    assert np.abs(paired.position_px - true_px).max() < 1e-3


def test_markers_that_are_expected_one_row_off_do_not_tear_the_skin():
    expected_px = stretched(1.1)
    expected_px[REST[:, 1] < 100] += [0, 19.0]  # three rows at the rim, by nearly one spacing
    paired = PAIRING.match(expected_px, spots(stretched(1.1)))
    assert np.abs(paired.position_px - stretched(1.1)).max() < 1e-3
    assert paired.found.all()


def test_hidden_markers_are_not_found_and_stand_where_their_neighbours_have_them():
    true_px = stretched(1.05)
    paired = PAIRING.match(true_px + np.array([2.0, -1.0]), spots(np.delete(true_px, [0, 40], axis=0)))
    assert np.flatnonzero(~paired.found).tolist() == [0, 40]
    assert np.linalg.norm(paired.position_px - true_px, axis=1).max() < 0.5


@pytest.mark.parametrize("places_px", [np.zeros((0, 2)), np.full((5, 2), 900.0)])
def test_no_spot_near_finds_nothing(places_px):
    assert not PAIRING.match(REST, spots(places_px)).found.any()


def test_density_needs_no_order_and_ignores_what_is_far_away():
    density = MarkerDensity(REST)
    shuffled = np.random.default_rng(1).permutation(REST)
    far = np.array([[5000.0, 5000.0], [-800.0, 40.0]])
    assert np.allclose(density.of(REST), density.of(np.concatenate([shuffled, far])), atol=1e-4)
    assert np.abs(density.of(REST) - density.of(stretched(1.1))).max() > 0.1
