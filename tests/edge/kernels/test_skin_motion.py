"""Skin motion and the split of a displacement, by NumPy in double precision."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate_edge.kernels.skin_motion import SkinMotionKernel, SkinWeights

BEADS = 27
RANDOM = np.random.default_rng(6)
REST_PX = RANDOM.uniform(0, 300, (BEADS, 2))
SPACING_PX = RANDOM.uniform(15, 30, BEADS)
APART = np.linalg.norm(REST_PX[:, None] - REST_PX, axis=2) / SPACING_PX[:, None]
AVERAGING, NEIGHBOURS = np.exp(-0.1 * APART**2), np.exp(-0.2 * APART**2) * (1 - np.eye(BEADS))
DENTED = np.exp(-0.15 * APART**2)
WEIGHTS = SkinWeights(AVERAGING, NEIGHBOURS, DENTED)
MODES = RANDOM.standard_normal((BEADS, 2, 6))
MOVED_PX = RANDOM.standard_normal((BEADS, 2))
ONE, EVERYWHERE = np.ones(BEADS), np.ones(BEADS, np.bool_)


def skin():
    return SkinMotionKernel(REST_PX, SPACING_PX, WEIGHTS, MODES)


def seen():
    """Some beads lost, some inexact."""
    found = RANDOM.uniform(size=BEADS) > 0.2
    return np.where(found, RANDOM.uniform(0.1, 1.0, BEADS), 0.0), found


def mean(weights, values, weight):
    return (weights * weight) @ values / (weights * weight).sum(axis=1)[:, None]


def rms(vectors):
    return math.sqrt((vectors**2).sum() / len(vectors))


def test_exact_beads_move_as_the_mean_of_their_neighbours():
    motion = skin().measure(REST_PX + MOVED_PX, ONE, EVERYWHERE, all_exact=True)
    rough = (MOVED_PX - mean(NEIGHBOURS, MOVED_PX, ONE)) / SPACING_PX[:, None]
    assert motion.moved_px[0] == pytest.approx(REST_PX + MOVED_PX, abs=1e-12)
    assert motion.moved_px[1] == pytest.approx(MOVED_PX, abs=1e-12)
    assert motion.size_px == pytest.approx(rms(mean(AVERAGING, MOVED_PX, ONE)), rel=1e-6)
    assert motion.roughness == pytest.approx(rms(rough), rel=1e-6)
    assert motion.noise == 1.0


def test_inexact_beads_count_by_the_variance_of_their_mean():
    weight, found = seen()
    motion = skin().measure(REST_PX + MOVED_PX, weight, found, all_exact=False)
    exact = (AVERAGING**2).sum(axis=1) / AVERAGING.sum(axis=1) ** 2
    share = exact * (AVERAGING @ weight) ** 2 / (AVERAGING**2 @ weight)
    share, size = np.minimum(share, 1.0)[found], (mean(AVERAGING, MOVED_PX, weight)[found] ** 2).sum(axis=1)
    rough = (MOVED_PX - mean(NEIGHBOURS, MOVED_PX, weight)) * (np.sqrt(weight) / SPACING_PX)[:, None]
    assert motion.size_px == pytest.approx(math.sqrt(share @ size / share.sum()), rel=1e-5)
    assert motion.roughness == pytest.approx(rms(rough[found]), rel=1e-5)
    assert motion.noise == pytest.approx(math.sqrt(len(share) / share.sum()), rel=1e-5)


def test_no_bead_shows_no_motion():
    motion = skin().measure(REST_PX + MOVED_PX, 0 * ONE, ~EVERYWHERE, all_exact=False)
    assert motion[1:] == (0.0, 0.0, 1.0, 0.0)


@pytest.mark.parametrize("all_seen", [True, False])
def test_the_common_part_is_that_of_least_squares(all_seen):
    weight, found = (ONE, EVERYWHERE) if all_seen else seen()
    root = np.repeat(np.sqrt(weight), 2)
    amounts = np.linalg.lstsq(root[:, None] * MODES.reshape(-1, 6), root * MOVED_PX.ravel())[0]
    motion = skin().measure(REST_PX + MOVED_PX, weight, found, all_exact=all_seen)
    common_px, dent_px = motion.moved_px[2:]
    assert common_px == pytest.approx(MODES @ amounts, abs=1e-9)
    assert dent_px == pytest.approx((MOVED_PX - MODES @ amounts) * found[:, None], abs=1e-9)


def test_a_dent_is_averaged_over_the_found_beads():
    weight, found = seen()
    motion = skin().measure(REST_PX + MOVED_PX, weight, found, all_exact=False)
    expected = rms(mean(DENTED, motion.moved_px[3], weight)[found])
    assert motion.dent_size_px == pytest.approx(expected, rel=1e-5)


def test_a_drift_is_taken_off_before_anything_else():
    """The slopes turn what is left of the displacement."""
    kernel, drift_px = skin(), RANDOM.standard_normal((BEADS, 2))
    slopes = np.eye(2) + 0.1 * RANDOM.standard_normal((BEADS, 2, 2))
    kernel.drift(REST_PX + drift_px, slopes)
    motion = kernel.measure(REST_PX + MOVED_PX, ONE, EVERYWHERE, all_exact=True)
    moved_px = np.einsum("nij,nj->ni", slopes, MOVED_PX - drift_px)
    expected = skin().measure(REST_PX + moved_px, ONE, EVERYWHERE, all_exact=True)
    assert motion.moved_px == pytest.approx(expected.moved_px, abs=1e-9)
    assert motion[1:] == pytest.approx(expected[1:], rel=1e-6)


@settings(deadline=None, max_examples=50)
@given(st.floats(), st.floats(), st.integers(0, BEADS - 1), st.booleans())
def test_any_number_is_computed_with(moved, bead_weight, place, all_exact):
    moved_px, weight = MOVED_PX.copy(), ONE.copy()
    moved_px[place], weight[place] = moved, bead_weight
    assert len(skin().measure(moved_px, weight, EVERYWHERE, all_exact=all_exact)) == 5


def test_weights_of_other_beads_are_refused():
    with pytest.raises(ValueError, match="do not fit"):
        SkinMotionKernel(REST_PX, SPACING_PX, SkinWeights(AVERAGING, NEIGHBOURS, DENTED[1:]), MODES)
    with pytest.raises(ValueError, match="do not fit"):
        SkinMotionKernel(REST_PX, SPACING_PX, WEIGHTS, MODES[1:])
