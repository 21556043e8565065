"""The independent check of pin labels: a smooth warp is followed, a row that is one off is seen."""

from __future__ import annotations

import numpy as np
import pytest
from bench.pin_labels import CheckedFrame, report, wrong_labels


@pytest.fixture(scope="module")
def lattice():
    """61 markers of a hexagon, 10 px apart, and where a smooth warp of up to 0.9 spacings brings them."""
    rest_px = np.array(
        [(10 * (q + r / 2), 10 * r * 0.75**0.5) for q in range(-4, 5) for r in range(-4, 5) if abs(q + r) < 5]
    )
    x, y = rest_px.T / 40
    return rest_px, rest_px + np.stack([9 * np.exp(-(x**2) - y**2), 3 * x * y], axis=1)


def test_labels_of_a_smooth_warp_are_right(lattice):
    rest_px, moved_px = lattice
    blobs_px = np.random.default_rng(1).permutation(np.vstack([moved_px[3:], [[48.0, 44.0]]]))
    assert not wrong_labels(rest_px, moved_px + 2.0, blobs_px, moved_px).any()


def test_a_row_that_is_one_off_and_a_start_that_is_one_off_are_seen(lattice):
    rest_px, moved_px = lattice
    torn_px, row = moved_px.copy(), np.flatnonzero(np.isclose(rest_px[:, 1], 0.0))
    torn_px[row[:-1]] = moved_px[row[1:]]
    wrong = wrong_labels(rest_px, moved_px + np.array([10.0, 0.0]), moved_px, torn_px)
    assert np.flatnonzero(wrong).tolist() == row[:-1].tolist()


def test_the_report_counts_pins_of_answered_frames():
    frames = [
        CheckedFrame(True, 1.5, 100, 1),
        CheckedFrame(True, 1.9, 100, 0),
        CheckedFrame(False, 1.2, 50, 50),
    ]
    assert report(frames).splitlines()[-1].split("|")[1:6] == [" 1 to 2 mm ", " 3 ", " 2 ", " 0.50 % ", " 1 "]
