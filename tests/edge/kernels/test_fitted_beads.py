"""Which beads the symmetric fit accepts: the rules by NumPy, from centres that are measured alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate_edge.vision.bead_fit import BeadFit
from palpate_edge.vision.beads import COLOUR_FIT, Reference
from palpate_edge.vision.symmetric_fit import SymmetricFit

SPACING_PX, DIAMETER_PX, SIGMA_PX = 30.0, 14.0, 0.5
REST_PX = 30.25 + SPACING_PX * np.stack(np.meshgrid(np.arange(4), np.arange(4)), axis=-1).reshape(-1, 2)
COUNT = len(REST_PX)
ROW, COLUMN = np.mgrid[0:160, 0:160]
ONES = np.ones(COUNT)
REFERENCE = Reference(REST_PX, DIAMETER_PX * ONES, 100.0 * ONES, ONES, fit_sigma_px=SIGMA_PX)


def picture(place_px: np.ndarray, random: np.random.Generator, light: float = 0.0) -> np.ndarray:
    """Cyan disks on grey skin; light: added to half of the picture, where it turns white."""
    image = np.full((*ROW.shape, 3), 150.0)
    for x, y in place_px:
        share = 1.0 / (1.0 + np.exp((np.hypot(COLUMN - x, ROW - y) - DIAMETER_PX / 2) / 0.7))
        image -= share[:, :, None] * np.array([20.0, 30.0, 110.0])
    image[:, 80:] += light
    image += random.normal(0.0, 3.0, image.shape)
    return np.clip(image, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("light", [0.0, 90.0, 200.0])
@pytest.mark.parametrize("seed", range(3))
def test_beads_are_accepted_by_step_noise_and_profile(seed: int, light: float) -> None:
    random = np.random.default_rng(seed)
    image = picture(REST_PX + random.uniform(-1.0, 1.0, (COUNT, 2)), random, light)
    before = random.random(COUNT) < 0.7
    start_px = REST_PX + random.uniform(-4.0, 4.0, (COUNT, 2))
    fit = BeadFit(REFERENCE, SIGMA_PX)
    fit.load(image)
    position_px, found, noise = fit.fit(start_px, before, accepts_lost=True)
    near = np.exp(-0.5 * (np.linalg.norm(REST_PX[:, None] - REST_PX, axis=2) / SPACING_PX) ** 2) * before
    moved = near @ (start_px - REST_PX) / near.sum(axis=1, keepdims=True)
    begun_px = np.where(before[:, None], start_px, REST_PX + moved)
    single = SymmetricFit(REFERENCE.diameter_px, np.full(COUNT, SPACING_PX), COLOUR_FIT)
    single.load(image)
    centres = single.measure(begun_px)
    step = np.linalg.norm(centres.position_px - begun_px, axis=1)
    sigma = np.maximum(1.0, centres.sigma_px / SIGMA_PX)
    white = (centres.explained > 0.5) & (centres.clipped > 0.75) & (sigma < 30.0)
    expected = np.where(
        before,
        (step < 0.25 * DIAMETER_PX) & (sigma < 10.0),
        (white | (sigma < 2.0)) & (step < 0.2 * DIAMETER_PX),
    )
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_allclose(
        position_px, np.where(found[:, None], centres.position_px, begun_px), atol=1e-4
    )
    np.testing.assert_allclose(noise, np.where(found, sigma, 1.0), rtol=1e-4)
    assert (fit.fit(start_px, before, accepts_lost=False)[1] <= before).all()


def test_no_bead_is_found_beside_another_one() -> None:
    """Two numbers for one disk: the one that was found before keeps it."""
    rest_px = REST_PX.copy()
    rest_px[5] = rest_px[6] + (3.0, 0.0)
    fit = BeadFit(replace(REFERENCE, position_px=rest_px), SIGMA_PX)
    fit.load(picture(np.delete(REST_PX, 5, axis=0), np.random.default_rng(1)))
    before = np.ones(COUNT, np.bool_)
    before[5] = False
    _, found, _ = fit.fit(rest_px, before, accepts_lost=True)
    assert found[6] and not found[5]


@settings(deadline=None, max_examples=30)
@given(
    st.lists(st.tuples(st.floats(), st.floats()), min_size=COUNT, max_size=COUNT),
    st.lists(st.booleans(), min_size=COUNT, max_size=COUNT),
)
def test_places_without_sense_end(places, before) -> None:
    fit = BeadFit(REFERENCE, SIGMA_PX)
    fit.load(picture(REST_PX, np.random.default_rng(0)))
    position_px, found, noise = fit.fit(np.array(places), np.array(before), accepts_lost=True)
    assert position_px.shape == (COUNT, 2) and (noise >= 1.0).all()
    assert np.isfinite(position_px[found]).all()
