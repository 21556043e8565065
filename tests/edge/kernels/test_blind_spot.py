"""The variance at beads that are not seen exactly: that of a Gaussian process given the others."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate_edge.kernels.blind_spot import BlindSpotKernel

BEADS, NOISE = 24, 1e-3
RANDOM = np.random.default_rng(5)
PLACES = RANDOM.uniform(0, 3, (BEADS, 2))
COVARIANCE = np.exp(-np.linalg.norm(PLACES[:, None] - PLACES, axis=2))


def kernel():
    return BlindSpotKernel(np.linalg.inv(COVARIANCE + NOISE * np.eye(BEADS)), NOISE)


def predicted(variance):
    """Largest variance at the beads of this variance of their places; infinite: hidden.

    Rasmussen and Williams, eq. 2.26, with an inexact bead's own measurement among the given ones.
    """
    seen = np.isfinite(variance)
    gram = COVARIANCE[np.ix_(seen, seen)] + np.diag(variance[seen])
    left = COVARIANCE - COVARIANCE[:, seen] @ np.linalg.inv(gram) @ COVARIANCE[seen]
    return left.diagonal()[variance > NOISE].max()


@pytest.mark.parametrize("count", [1, 7, BEADS - 1])
def test_hidden_beads_have_the_predicted_variance(count):
    found = np.arange(BEADS) >= count
    expected = predicted(np.where(found, NOISE, np.inf))
    assert kernel().largest_variance(found, None) == pytest.approx(expected, abs=1e-9)


def test_an_inexact_bead_counts_by_its_noise():
    """A bead of noise q: its place has the variance NOISE q^2, of which NOISE is taken for its own motion."""
    noise = np.ones(BEADS, np.float32)
    noise[[2, 9, 11]] = 2.0, 5.0, 30.0
    found = np.ones(BEADS, np.bool_)
    found[4] = False
    some = np.array([2, 4, 9, 11])
    inverse = np.linalg.inv(COVARIANCE + NOISE * np.eye(BEADS))[np.ix_(some, some)]
    inverse += np.diag([1 / (NOISE * 3), 0.0, 1 / (NOISE * 24), 1 / (NOISE * 899)])
    expected = np.linalg.inv(inverse).diagonal().max() - NOISE
    assert kernel().largest_variance(found, noise) == pytest.approx(expected, rel=1e-6)


def test_exact_beads_leave_no_blind_spot():
    spot, everywhere = kernel(), np.ones(BEADS, np.bool_)
    assert spot.largest_variance(np.arange(BEADS) > 2, None) > 0.1
    assert spot.largest_variance(everywhere, None) == 0.0
    assert spot.largest_variance(everywhere, np.full(BEADS, 0.9, np.float32)) == 0.0


@settings(deadline=None, max_examples=50)
@given(st.lists(st.booleans(), min_size=BEADS, max_size=BEADS), st.floats(width=32))
def test_any_noise_is_computed_with(found, noise):
    values = np.full(BEADS, noise, np.float32)
    assert isinstance(kernel().largest_variance(np.array(found), values), float)
