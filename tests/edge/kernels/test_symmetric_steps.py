"""Steps to centres of symmetry: places anywhere, images of any size, beads that are not there."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate_edge.vision.beads import BOTH_FIT, COLOUR_FIT, GREY_FIT, SLOPED_LIGHT
from palpate_edge.vision.symmetric_fit import SymmetricFit

DIAMETER_PX = 9.0
ANYWHERE = st.one_of(st.floats(), st.floats(-100.0, 200.0))


def fit_of(channels: str) -> SymmetricFit:
    return SymmetricFit(np.full(2, DIAMETER_PX), np.array([30.0, 10.0]), channels, SLOPED_LIGHT)


@pytest.mark.parametrize("channels", [COLOUR_FIT, GREY_FIT, BOTH_FIT])
@given(x=ANYWHERE, y=ANYWHERE, height=st.integers(4, 40), width=st.integers(4, 40), seed=st.integers(0, 99))
def test_no_place_leads_outside_the_image(channels, x, y, height, width, seed):
    image = np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)
    fit = fit_of(channels)
    fit.load(image)
    found = fit.measure(np.array([[x, y], [5.0, 5.0]]))
    assert np.isfinite(found.position_px[1]).all()
    assert ((found.clipped >= 0) & (found.clipped <= 1)).all()


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_where_all_pixels_are_alike_no_place_is_known(grey):
    fit = fit_of(COLOUR_FIT)
    fit.load(np.full((60, 60, 3), grey, np.uint8))
    found = fit.measure(np.full((2, 2), 30.0))
    assert (found.sigma_px > 100 * DIAMETER_PX).all()
    assert np.allclose(found.position_px, 30.0)
    assert not found.explained.any()


def test_samples_are_read_between_pixels():
    """A ramp is the light's plane alone: nothing of it is a bead's profile, at any place."""
    row, column = np.mgrid[0:60, 0:60]
    fit = fit_of(GREY_FIT)
    fit.load((2 * column + row).astype(np.uint8))
    assert fit.measure(np.array([[28.3, 31.8], [33.1, 27.4]])).explained.max() < 1e-3


def test_other_numbers_of_beads_are_refused():
    fit = fit_of(COLOUR_FIT)
    fit.load(np.zeros((60, 60, 3), np.uint8))
    with pytest.raises(ValueError, match="2 beads were given"):
        fit.measure(np.zeros((3, 2)))
    with pytest.raises(ValueError, match="among the 2"):
        fit.measure(np.zeros((2, 2)), np.array([0, 2]))
    with pytest.raises(ValueError, match="1 x 40 pixels"):
        fit.load(np.zeros((80, 2, 3), np.uint8))
