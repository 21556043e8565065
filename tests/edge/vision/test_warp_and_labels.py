"""Predictions from neighbours by numpy's weighted least squares, labels of beads that meet, and patches."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate_edge.vision.beads import Reference
from palpate_edge.vision.blob_detection import Blobs
from palpate_edge.vision.correspondence import MIN_PATCH, Correspondence
from palpate_edge.vision.labels import LabelCheck
from palpate_edge.vision.local_warp import LocalWarp
from palpate_edge.vision.neighbourhood import Neighbourhood, interpolate, rms, row_normalised

SPACING_PX = 20.0
PAIRS = [(q, r) for q in range(-4, 5) for r in range(-4, 5) if abs(q + r) <= 4]
REST_PX = 300.0 + SPACING_PX * np.array([(q + 0.5 * r, math.sqrt(0.75) * r) for q, r in PAIRS])
COUNT = len(REST_PX)
NEIGHBOURS = Neighbourhood(REST_PX)
KNOWN = np.random.default_rng(3).random(COUNT) < 0.8
AFFINE = REST_PX @ np.array([[0.02, -0.05], [0.03, 0.01]]) + np.array([1.0, -2.0])


def reference(diameter_px: float = 8.0) -> Reference:
    return Reference(REST_PX, np.full(COUNT, diameter_px), np.full(COUNT, 90.0), np.ones(COUNT))


def test_an_affine_motion_is_predicted_but_for_the_ridge() -> None:
    """Inside of the lattice the gradient's ridge takes a twentieth of a squared spacing: a few per cent."""
    predicted, support = LocalWarp(NEIGHBOURS).predict(AFFINE, np.ones(COUNT, np.bool_))
    inside = np.linalg.norm(REST_PX - 300.0, axis=1) < 2.1 * SPACING_PX
    np.testing.assert_allclose(predicted[inside], AFFINE[inside], atol=0.02)
    np.testing.assert_allclose(support, 1.0, rtol=1e-5)


def test_a_prediction_is_a_ridge_regression_on_the_known_neighbours() -> None:
    """For each bead: a plane through the others, by weights of a Gaussian of 1.1 spacings within 2.6."""
    moved = AFFINE + np.random.default_rng(4).normal(0.0, 0.5, (COUNT, 2))
    predicted, support = LocalWarp(NEIGHBOURS).predict(moved, KNOWN)
    apart_px = np.linalg.norm(REST_PX[:, None] - REST_PX[None], axis=2)
    local_px = np.sort(apart_px, axis=1)[:, 1:5].mean(axis=1)  # to the four nearest
    apart = apart_px / local_px[:, None]
    weights = np.where(apart < 2.6, np.exp(-0.5 * (apart / 1.1) ** 2), 0.0)
    np.fill_diagonal(weights, 0.0)
    for bead in range(COUNT):
        weight = weights[bead] * KNOWN
        total = weight.sum()
        mean, ahead = weight @ REST_PX / total, REST_PX[bead] / SPACING_PX
        place = (REST_PX - mean) / SPACING_PX
        shift = weight @ moved / total
        spread = (place * weight[:, None]).T @ place / total + 0.05 * np.eye(2)
        slope = np.linalg.solve(spread, (place * weight[:, None]).T @ moved / total)
        expected = shift + (ahead - mean / SPACING_PX) @ slope
        np.testing.assert_allclose(predicted[bead], expected, atol=2e-3)
        assert support[bead] == pytest.approx(total / weights[bead].sum(), rel=1e-4)


def test_a_bead_without_known_neighbours_has_no_support() -> None:
    predicted, support = LocalWarp(NEIGHBOURS).predict(AFFINE, np.zeros(COUNT, np.bool_))
    assert not predicted.any() and support.max() < 1e-6


def test_missing_beads_move_like_their_neighbours() -> None:
    """Gaussian weights of the distance in spacings; without any neighbour the reference's place."""
    missing = np.array([0, 30])
    found = np.ones(COUNT, np.bool_)
    found[missing] = False
    got = NEIGHBOURS.predict(REST_PX + AFFINE, found, missing)
    apart = np.linalg.norm(REST_PX[missing][:, None] - REST_PX[None], axis=2) / SPACING_PX
    weight = np.exp(-0.5 * apart**2) * found
    expected = REST_PX[missing] + weight @ AFFINE / weight.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(got, expected, rtol=1e-9)
    nothing = NEIGHBOURS.predict(REST_PX + AFFINE, np.zeros(COUNT, np.bool_), missing)
    np.testing.assert_array_equal(nothing, REST_PX[missing])
    far = np.zeros(COUNT, np.bool_)
    far[-1] = True
    np.testing.assert_allclose(
        NEIGHBOURS.predict(REST_PX + AFFINE, far, missing), REST_PX[missing] + AFFINE[-1]
    )


def test_distances_and_means_of_a_neighbourhood() -> None:
    np.testing.assert_allclose(NEIGHBOURS.spacing_px, SPACING_PX)
    middle = int(np.argmin(np.linalg.norm(REST_PX - 300.0, axis=1)))
    near = set(NEIGHBOURS.nearest(6)[middle].tolist())
    assert near == set(np.flatnonzero(np.abs(NEIGHBOURS.relative[middle] - 1.0) < 1e-9).tolist())
    first, second = NEIGHBOURS.pairs(1.01)
    assert len(first) == 156 and (first < second).all()  # edges of a hexagon of 61 points
    np.testing.assert_allclose(
        interpolate(np.array([[100.0, 101.0]]), np.array([[1.0], [0.0]])), 1.0, atol=1e-9
    )
    np.testing.assert_allclose(row_normalised(np.array([[1.0, 3.0], [0.0, 0.0]])), [[0.25, 0.75], [0.0, 0.0]])
    assert rms(np.array([[3.0, 4.0], [0.0, 0.0]])) == pytest.approx(math.sqrt(12.5))


@pytest.mark.parametrize(("step", "jumps"), [(0.19, False), (0.21, True)])
def test_a_step_of_a_fifth_of_the_spacing_is_a_jump(step: float, jumps: bool) -> None:
    moved = REST_PX.copy()
    moved[5, 0] += step * SPACING_PX
    found = np.ones(COUNT, np.bool_)
    assert LabelCheck(reference()).check((moved, found), REST_PX) == (0, jumps)
    found[5] = False
    assert LabelCheck(reference()).check((moved, found), REST_PX) == (1, False)


@pytest.mark.parametrize(("apart_px", "is_double"), [(3.9, True), (4.1, False)])
def test_of_two_beads_at_one_place_the_one_from_farther_is_dropped(apart_px: float, is_double: bool) -> None:
    """Nearer than half a diameter, 4 px, they share a place."""
    one, other = 30, int(np.argsort(np.linalg.norm(REST_PX - REST_PX[30], axis=1))[1])
    moved, found = REST_PX.copy(), np.ones(COUNT, np.bool_)
    way = (REST_PX[other] - REST_PX[one]) / SPACING_PX
    moved[one] = REST_PX[other] - apart_px * way
    checked = LabelCheck(reference()).check((moved, found), REST_PX)
    assert found[one] == (not is_double) and checked.lost == COUNT - found.sum() == is_double


def test_patches_are_joined_by_small_steps_between_neighbours_and_have_eight_beads() -> None:
    """Two halves that moved apart by 0.3 spacings are two patches, by 0.2 spacings one."""
    matcher, known = Correspondence(NEIGHBOURS), np.ones(COUNT, np.bool_)
    right = REST_PX[:, 0] > 301.0
    for step, sizes in ((0.3, [int((~right).sum()), int(right.sum())]), (0.2, [COUNT])):
        moved = np.where(right[:, None], [step * SPACING_PX, 0.0], [0.0, 0.0])
        assert [int(patch.sum()) for patch in matcher.patches(moved, known)] == sizes
    order = np.argsort(np.linalg.norm(REST_PX - REST_PX[0], axis=1), kind="stable")
    for count, patches in ((MIN_PATCH - 1, 0), (MIN_PATCH, 1)):
        few = np.zeros(COUNT, np.bool_)
        few[order[:count]] = True
        assert len(list(matcher.patches(np.zeros((COUNT, 2)), few))) == patches


def test_fewer_blobs_than_a_patch_are_no_match() -> None:
    matcher = Correspondence(NEIGHBOURS)
    for count, found in ((MIN_PATCH - 1, 0), (MIN_PATCH, MIN_PATCH)):
        order = np.argsort(np.linalg.norm(REST_PX - REST_PX[0], axis=1), kind="stable")[:count]
        match = matcher.match(Blobs(REST_PX[order], np.full(count, 40.0)), REST_PX[None])
        assert match.found.sum() <= found
        assert (match.doubt == 1.0) is (found == 0)


@pytest.mark.parametrize(("off", "smooth"), [(0.2, True), (0.3, False)])
def test_a_bead_beside_its_prediction_is_not_smooth(off: float, smooth: bool) -> None:
    moved = REST_PX.copy()
    middle = int(np.argmin(np.linalg.norm(REST_PX - 300.0, axis=1)))
    moved[middle, 1] += off * SPACING_PX
    assert Correspondence(NEIGHBOURS).is_smooth(moved, np.ones(COUNT, np.bool_)) is smooth
