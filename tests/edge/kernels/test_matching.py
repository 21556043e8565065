"""Patches against scipy's shortest paths, and a match of any numbers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import shortest_path

from palpate_edge.geometry.points import distances
from palpate_edge.kernels.nearest_blob import NO_BLOB
from palpate_edge.vision.blob_detection import Blobs
from palpate_edge.vision.correspondence import MIN_PATCH, PATCH_STEP, Correspondence
from palpate_edge.vision.local_warp import LocalWarp
from palpate_edge.vision.neighbourhood import Neighbourhood

SIDE, SPACING_PX = 12, 20.0
REST_PX = SPACING_PX * np.stack(np.meshgrid(np.arange(SIDE), np.arange(SIDE)), axis=-1).reshape(-1, 2)
COUNT = len(REST_PX)
NEIGHBOURS = Neighbourhood(REST_PX)
MATCHER = Correspondence(NEIGHBOURS)
FLOATS = st.one_of(st.floats(-50.0, 300.0), st.floats(allow_nan=True, allow_infinity=True))


@pytest.mark.parametrize("seed", range(5))
def test_beads_are_of_the_patch_of_the_lowest_number_that_their_neighbours_reach(seed):
    random = np.random.default_rng(seed)
    known = random.random(COUNT) < 0.9
    moved = SPACING_PX * np.repeat(random.choice([0.0, 0.3], (COUNT, 1)), 2, axis=1) * (REST_PX[:, :1] > 90)
    near = NEIGHBOURS.nearest(6)
    bead, other = np.repeat(np.arange(COUNT), 6), near.ravel()
    step = np.linalg.norm(moved[bead] - moved[other], axis=1)
    joined = known[bead] & known[other] & (step < PATCH_STEP * SPACING_PX)
    joined &= np.linalg.norm(REST_PX[bead] - REST_PX[other], axis=1) < 1.7 * SPACING_PX
    graph = coo_array((joined[joined], (bead[joined], other[joined])), (COUNT, COUNT))
    label = np.isfinite(shortest_path(graph, unweighted=True)).argmax(axis=1)
    size = np.bincount(label[known])
    largest = sorted((count for count in size if count >= MIN_PATCH), reverse=True)[:4]
    patches = MATCHER.patches(moved, known)
    assert [patch.sum() for patch in patches] == largest
    for patch in patches:
        assert len(np.unique(label[patch])) == 1


def test_blobs_of_any_number_are_matched_one_after_the_other():
    random, order = np.random.default_rng(1), np.random.default_rng(2).permutation(COUNT)
    for others in (0, 500, 3):
        far = random.uniform(400.0, 900.0, (others, 2))
        blobs = Blobs(np.concatenate([REST_PX[order], far]), np.full(COUNT + others, 9.0))
        match = MATCHER.match(blobs, [REST_PX + 2.0] * 5)
        np.testing.assert_array_equal(order[match.blob], np.arange(COUNT))
        assert match.doubt == 0.0


def test_blobs_left_over_beside_beads_left_over_are_the_doubt() -> None:
    """Ten beads of the middle stand off their lattice, so that no prediction is near them."""
    middle = np.argsort(np.linalg.norm(REST_PX - 110.0, axis=1), kind="stable")[:10]
    place = REST_PX.copy()
    place[middle] += 0.5 * SPACING_PX
    match = MATCHER.match(Blobs(place, np.full(COUNT, 9.0)), REST_PX[None])
    spare = np.setdiff1d(np.arange(COUNT), match.blob)
    near = distances(place[spare], match.predicted_px).min(axis=1) < 1.3 * SPACING_PX
    assert match.doubt == min(near.sum(), (~match.found).sum()) / COUNT > 0.0


@given(st.lists(st.tuples(FLOATS, FLOATS, FLOATS), max_size=30), st.integers(1, 4), st.randoms())
@settings(max_examples=200, deadline=None)
def test_any_numbers_give_labels_of_blobs_or_none(garbage, hypotheses, random):
    blobs = np.concatenate(
        [np.array(garbage).reshape(-1, 3), np.column_stack([REST_PX, np.ones(COUNT)])[:40]]
    )
    expected = np.stack([REST_PX + random.uniform(-30.0, 30.0)] * hypotheses)
    for row in garbage[:5]:
        expected[random.randrange(hypotheses), random.randrange(COUNT)] = row[:2]
    match = MATCHER.match(Blobs(blobs[:, :2], blobs[:, 2]), expected)
    labelled = match.blob[match.found]
    assert ((match.blob >= NO_BLOB) & (match.blob < len(blobs))).all()
    assert len(np.unique(labelled)) == len(labelled)
    assert 0.0 <= match.doubt <= 1.0


def test_displacements_without_a_value_are_not_smooth():
    moved = REST_PX.copy()
    moved[3] = np.nan
    assert not MATCHER.is_smooth(moved, np.ones(COUNT, np.bool_))
    predicted, support = LocalWarp(NEIGHBOURS).predict(moved - REST_PX, np.arange(COUNT) != 3)
    assert np.isfinite(predicted).all() and support[3] == pytest.approx(1.0)
