"""Smoothing by typical fields: against dense linear algebra, and what it removes and keeps."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from palpate_edge.estimation.field_smoothing.smoother import LEAST_SIGNAL, NOISE_WEIGHT, FieldSmoother
from palpate_edge.estimation.field_smoothing.typical_fields import TypicalFields
from palpate_edge.estimation.pose.kernel_expansion import packed
from palpate_edge.vision.beads import Beads

BEADS, KEPT, REMAINDER = 30, 8, 0.005
NOISE_PX = 0.1


@pytest.fixture
def typical():
    """Return typical fields whose displacement has the mean square 1 an axis."""
    random = np.random.default_rng(3)
    fields, _ = np.linalg.qr(random.standard_normal((2 * BEADS, KEPT)))
    variance = 0.5 ** np.arange(KEPT)
    variance *= 2 * BEADS * (1 - REMAINDER) / variance.sum()
    return TypicalFields(packed(fields), packed(variance), REMAINDER)


def contact_px(typical, size_px, random):
    """Return a displacement (n, 2) with the typical fields' distribution, of a root mean square an axis."""
    fields, variance = typical.fields.array(), typical.variance.array()
    drawn = fields @ (np.sqrt(variance) * random.standard_normal(KEPT))
    drawn = drawn + np.sqrt(REMAINDER) * random.standard_normal(2 * BEADS)
    return (drawn * size_px / np.sqrt((drawn**2).mean())).reshape(-1, 2)


def seen(displacement_px, found=None, noise=None):
    found = np.ones(BEADS, np.bool_) if found is None else found
    return Beads.from_positions(displacement_px, found, noise=noise)


def test_the_likeliest_displacement_is_that_of_the_dense_gaussian_process(typical):
    random = np.random.default_rng(4)
    measured = contact_px(typical, 0.3, random) + NOISE_PX * random.standard_normal((BEADS, 2))
    found = random.uniform(size=BEADS) > 0.2
    noise = random.uniform(1.0, 3.0, BEADS).astype(np.float32)
    beads = seen(measured, found, noise)
    # Rasmussen and Williams (2006), eq. 2.25, with the covariance written out and the found beads alone.
    fields = typical.fields.array().astype(np.float64)
    prior = (fields * typical.variance.array()) @ fields.T + REMAINDER * np.eye(2 * BEADS)
    weight = np.where(found, 1 / noise.astype(np.float64) ** 2, 0.0)
    square = (weight[:, None] * measured**2).sum() / (2 * weight.sum())
    signal = max(square - NOISE_PX**2 * found.sum() / weight.sum(), LEAST_SIGNAL * square)
    rows = np.repeat(found, 2)
    errors = NOISE_WEIGHT * (NOISE_PX * np.repeat(noise.astype(np.float64), 2)[rows]) ** 2
    gram = signal * prior[np.ix_(rows, rows)] + np.diag(errors)
    expected = signal * prior[:, rows] @ np.linalg.solve(gram, measured.ravel()[rows])
    smoothed = FieldSmoother(typical, NOISE_PX).smooth(measured, beads)
    assert smoothed.ravel() == pytest.approx(expected, abs=1e-5)


def test_exact_beads_take_the_short_way_to_the_same_displacement(typical):
    random = np.random.default_rng(5)
    measured = contact_px(typical, 0.3, random) + NOISE_PX * random.standard_normal((BEADS, 2))
    smoother = FieldSmoother(typical, NOISE_PX)
    short = smoother.smooth(measured, seen(measured))
    long = smoother.smooth(measured, seen(measured, noise=np.ones(BEADS, np.float32)))
    assert short == pytest.approx(long, abs=1e-5)


def test_a_faint_contact_is_smoothed_and_a_firm_one_kept(typical):
    random = np.random.default_rng(6)
    smoother, left, kept = FieldSmoother(typical, NOISE_PX), [], []
    for _ in range(50):
        errors = NOISE_PX * random.standard_normal((BEADS, 2))
        faint, firm = contact_px(typical, 0.2, random), contact_px(typical, 30.0, random)
        left.append(smoother.smooth(faint + errors, seen(faint)) - faint)
        kept.append(smoother.smooth(firm + errors, seen(firm)) - (firm + errors))
    assert np.sqrt(np.mean(np.square(left))) < 0.55 * NOISE_PX  # of 60 numbers 8 are free: 0.37 at best
    assert np.sqrt(np.mean(np.square(kept))) < 0.2 * NOISE_PX


def test_a_hidden_bead_takes_the_displacement_of_the_typical_fields(typical):
    random = np.random.default_rng(7)
    true = contact_px(typical, 3.0, random)
    found = np.ones(BEADS, np.bool_)
    found[:5] = False
    wrong = true.copy()
    wrong[:5] = 50.0  # nothing is known of a place that was not measured
    smoothed = FieldSmoother(typical, 0.01).smooth(wrong, seen(wrong, found))
    assert np.abs(smoothed - true)[:5].max() < 1.0  # 0.2 px is the remainder's deviation


def test_no_bead_gives_no_displacement(typical):
    none = np.zeros(BEADS, np.bool_)
    measured = np.ones((BEADS, 2))
    assert not FieldSmoother(typical, NOISE_PX).smooth(measured, seen(measured, none)).any()


def test_typical_fields_survive_the_file(typical):
    again = msgspec.json.decode(msgspec.json.encode(typical), type=TypicalFields)
    assert again == typical
