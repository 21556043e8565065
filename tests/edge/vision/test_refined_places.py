"""Halved pixels, the slope of the skin, and sub-pixel places, on pictures computed from their definition."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import erf

from palpate_edge.vision.binning import halved
from palpate_edge.vision.shading import Shading, skin_reach, skin_slope
from palpate_edge.vision.subpixel import Refiner

PLACE_PX = np.array([[40.3, 35.8], [90.75, 44.2], [61.5, 90.1]])
BLUR_PX = 0.8


def cover_of(place_px: np.ndarray, diameter_px: float) -> np.ndarray:
    """Return the share, 0 to 1, of a blurred disk in each of 140 by 130 pixels."""
    row, column = np.mgrid[0:130, 0:140]
    cover = np.zeros((130, 140))
    for x, y in place_px:
        radius = np.hypot(column - x, row - y)
        cover += 0.5 * (1.0 - erf((radius - diameter_px / 2) / (np.sqrt(2.0) * BLUR_PX)))
    return cover


def test_a_halved_image_has_the_means_of_two_by_two() -> None:
    image = np.random.default_rng(1).uniform(0.0, 255.0, (7, 9, 3))
    expected = image[:6, :8].reshape(3, 2, 4, 2, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(halved(image), expected, rtol=1e-12)


def test_the_slope_of_a_plane_is_exact_and_outliers_do_not_count() -> None:
    row, column = np.mgrid[0:130, 0:140]
    plane = 100.0 + 0.4 * column - 0.25 * row
    diameter, spacing = np.full(3, 12.0), np.full(3, 40.0)
    np.testing.assert_allclose(
        skin_slope(plane, PLACE_PX, diameter, spacing), np.tile([0.4, -0.25], (3, 1)), atol=1e-6
    )
    spoilt = plane.copy()
    spoilt[35:38, 48:52] += 80.0
    np.testing.assert_allclose(
        skin_slope(spoilt, PLACE_PX, diameter, spacing), np.tile([0.4, -0.25], (3, 1)), atol=1e-6
    )


def test_beads_too_close_to_each_other_have_no_slope() -> None:
    """The ring ends 0.58 diameters before the neighbour: at a spacing of 1.2 diameters nothing is left."""
    row, column = np.mgrid[0:130, 0:140]
    plane = 100.0 + 0.4 * column - 0.25 * row
    slope = skin_slope(plane, PLACE_PX, np.full(3, 12.0), np.array([14.4, 40.0, 40.0]))
    np.testing.assert_array_equal(slope[0], 0.0)
    np.testing.assert_allclose(slope[1:], np.tile([0.4, -0.25], (2, 1)), atol=1e-6)
    np.testing.assert_allclose(skin_reach(np.array([10.0, 10.0]), np.array([20.0, 11.0])), [14.2, 5.5])


@pytest.mark.parametrize("diameter_px", [7.0, 10.0, 16.0])
def test_a_disk_on_even_skin_is_found_to_an_eightieth_of_a_pixel(diameter_px: float) -> None:
    """A pixel is one of two by two for beads of 12 px and more."""
    grey = (180.0 - 140.0 * cover_of(PLACE_PX, diameter_px)).astype(np.float32)
    refiner = Refiner(np.full(3, diameter_px))
    assert refiner.binning == (2 if diameter_px >= 12.0 else 1)
    found = refiner.refine(grey, PLACE_PX + np.array([[0.4, -0.3], [-0.5, 0.5], [0.2, 0.6]]))
    np.testing.assert_allclose(found.position_px, PLACE_PX, atol=0.0125 * refiner.binning)
    np.testing.assert_allclose(found.contrast, 140.0, rtol=0.06)  # blur reaches the circles on skin and bead
    np.testing.assert_allclose(found.unevenness, 0.0, atol=0.02)
    np.testing.assert_allclose(found.area, 1.0, atol=0.12)
    assert found.converged.all()


@pytest.mark.parametrize(("unlit", "slope"), [(0.0, 1.2), (20.0, 1.2), (None, 1.2)])
def test_the_shading_of_the_skin_displaces_no_bead(unlit: float | None, slope: float) -> None:
    """Light that grows from left to right: the bead is lit like the skin, or (None) not at all."""
    column = np.mgrid[0:130, 0:140][1]
    base, cover = unlit or 0.0, cover_of(PLACE_PX, 10.0)
    skin = 150.0 + slope * (column - 70.0)
    if unlit is None:
        grey, contrast = skin * (1.0 - cover) + 40.0 * cover, skin - 40.0
    else:
        grey = base + (skin - base) * (1.0 - 0.8 * cover)
        contrast = 0.8 * (skin - base)
    at = np.rint(PLACE_PX).astype(int)
    relative = np.column_stack([slope / contrast[at[:, 1], at[:, 0]], np.zeros(3)])
    plain = Refiner(np.full(3, 10.0)).refine(grey.astype(np.float32), PLACE_PX)
    found = Refiner(np.full(3, 10.0), shading=Shading(relative, unlit)).refine(
        grey.astype(np.float32), PLACE_PX
    )
    off_px = np.linalg.norm(found.position_px - PLACE_PX, axis=1)
    assert off_px.max() < 0.03
    assert off_px.max() < 0.5 * np.linalg.norm(plain.position_px - PLACE_PX, axis=1).max()


def test_faint_places_take_no_second_step_and_too_many_of_them_none() -> None:
    grey = (180.0 - 140.0 * cover_of(PLACE_PX, 10.0)).astype(np.float32)
    refiner = Refiner(np.full(3, 10.0))
    refiner.load(grey)
    start = PLACE_PX + np.array([[2.5, 0.0], [0.0, 0.0], [0.0, 0.0]])
    whole = refiner.centroids(start)
    np.testing.assert_allclose(whole.position_px, PLACE_PX, atol=0.012)
    once = refiner.centroids(start, max_steps=1)
    assert not once.converged[0] and once.converged[1:].all()
    assert 0.02 < abs(once.position_px[0, 0] - PLACE_PX[0, 0]) < 2.0
    faint = refiner.centroids(start, min_contrast=np.array([1e3, 0.0, 0.0]))
    np.testing.assert_array_equal(faint.position_px[0], once.position_px[0])
    none = refiner.centroids(start, min_contrast=1e3, max_faint=2)
    np.testing.assert_array_equal(none.position_px, start)
    assert not none.converged.any() and not none.area.any()
    assert refiner.centroids(start, min_contrast=1e3, max_faint=3).area.all()


def test_some_beads_alone_are_measured_as_among_all() -> None:
    grey = (180.0 - 140.0 * cover_of(PLACE_PX, 10.0)).astype(np.float32)
    refiner = Refiner(np.array([9.0, 10.0, 11.0]), np.array([30.0, 30.0, 30.0]))
    refiner.load(grey)
    whole, some = refiner.centroids(PLACE_PX + 0.4), refiner.centroids(PLACE_PX[1:] + 0.4, np.array([1, 2]))
    np.testing.assert_allclose(some.position_px, whole.position_px[1:], atol=1e-6)
    np.testing.assert_allclose(some.area, whole.area[1:], rtol=1e-5)


def test_a_start_outside_of_the_image_stays_there_without_contrast() -> None:
    grey = (180.0 - 140.0 * cover_of(PLACE_PX, 10.0)).astype(np.float32)
    start = np.array([[-3.0, 20.0], [90.0, 44.0], [61.0, 131.0]])
    found = Refiner(np.full(3, 10.0)).refine(grey, start)
    np.testing.assert_array_equal(found.contrast[[0, 2]], 0.0)
    np.testing.assert_array_equal(found.position_px[[0, 2]], start[[0, 2]])
    np.testing.assert_allclose(found.position_px[1], PLACE_PX[1], atol=0.012)
