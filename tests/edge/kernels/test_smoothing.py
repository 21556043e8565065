"""The likeliest displacement by the dense Gaussian process."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import ortho_group

from palpate_edge.kernels.smoothing import SmoothingKernel

BEADS, FIELDS, REMAINDER, NOISE_PX2, NOISE_WEIGHT, LEAST_SIGNAL = 20, 13, 0.04, 0.05, 2.0, 0.1
RANDOM = np.random.default_rng(3)
TYPICAL = ortho_group.rvs(2 * BEADS, random_state=3)[:, :FIELDS]
VARIANCE = np.geomspace(9.0, 0.05, FIELDS)
MEASURED_PX = RANDOM.standard_normal((BEADS, 2))


def kernel():
    return SmoothingKernel(
        TYPICAL,
        VARIANCE,
        noise_px2=NOISE_PX2,
        noise_weight=NOISE_WEIGHT,
        remainder=REMAINDER,
        least_signal=LEAST_SIGNAL,
    )


def dense(weight, found):
    """Rasmussen and Williams (2006), eq. 2.25, of the beads that count."""
    seen = np.repeat(weight > 0, 2)
    square = (weight @ MEASURED_PX**2).sum() / (2 * weight.sum())
    signal = max(square - NOISE_PX2 * found / weight.sum(), LEAST_SIGNAL * square)
    prior = signal * ((TYPICAL * VARIANCE) @ TYPICAL.T + REMAINDER * np.eye(2 * BEADS))
    noise = NOISE_WEIGHT * NOISE_PX2 / np.repeat(weight, 2)[seen]
    gain = np.linalg.inv(prior[np.ix_(seen, seen)] + np.diag(noise))
    return (prior[:, seen] @ gain @ MEASURED_PX.ravel()[seen]).reshape(-1, 2)


@pytest.mark.parametrize("inexact", [0, 1, 6, BEADS])
@pytest.mark.parametrize("lost", [0, 3])
def test_the_displacement_is_that_of_the_dense_process(inexact, lost):
    weight = np.ones(BEADS)
    weight[:inexact] = RANDOM.uniform(0.05, 1.0, inexact)
    weight[BEADS - lost :] = 0.0
    smoothed = kernel().smooth(MEASURED_PX, weight, BEADS - lost, all_exact=False)
    assert smoothed == pytest.approx(dense(weight, BEADS - lost), abs=1e-9)


def test_exact_beads_are_smoothed_alike_with_and_without_solving():
    one = np.ones(BEADS)
    solved = kernel().smooth(MEASURED_PX, one, BEADS, all_exact=False)
    assert kernel().smooth(MEASURED_PX, one, BEADS, all_exact=True) == pytest.approx(solved, abs=1e-9)


def test_the_frame_before_leaves_nothing():
    smoother, weight = kernel(), RANDOM.uniform(0.1, 1.0, BEADS)
    first = smoother.smooth(MEASURED_PX, weight, BEADS, all_exact=False)
    smoother.smooth(5 * MEASURED_PX, 0.5 * weight, BEADS, all_exact=False)
    assert (smoother.smooth(MEASURED_PX, weight, BEADS, all_exact=False) == first).all()
    assert not smoother.smooth(MEASURED_PX, np.zeros(BEADS), 0, all_exact=False).any()


@settings(deadline=None, max_examples=50)
@given(st.floats(), st.floats(), st.integers(0, BEADS - 1), st.booleans())
def test_any_number_is_computed_with(moved, bead_weight, place, all_exact):
    measured_px, weight = MEASURED_PX.copy(), np.ones(BEADS)
    measured_px[place], weight[place] = moved, bead_weight
    assert kernel().smooth(measured_px, weight, BEADS, all_exact=all_exact).shape == (BEADS, 2)


def test_fields_of_half_a_bead_are_refused():
    with pytest.raises(ValueError, match="typical fields"):
        SmoothingKernel(
            TYPICAL[1:], VARIANCE, noise_px2=0.0, noise_weight=1.0, remainder=0.1, least_signal=0.1
        )
