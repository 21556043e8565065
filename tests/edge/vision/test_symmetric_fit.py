"""Places by symmetry, of cyan balls drawn in light that is uneven, saturated or dim."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from palpate_edge.vision.appearance import Appearance, plane
from palpate_edge.vision.beads import BOTH_FIT, COLOUR_FIT, EVEN_LIGHT, SLOPED_LIGHT, Reference
from palpate_edge.vision.subpixel import Refiner
from palpate_edge.vision.symmetric_fit import SymmetricFit
from palpate_edge.vision.tracker import Tracker

BLUE_RED = Appearance("blue-red", bright=True)
SKIN, BEAD = np.array([1.0, 1.0, 0.88]), np.array([1.5, 1.4, 0.7])  # B, G, R over the light
DIAMETER_PX, SPACING_PX = 16.0, 40.0
PLACES = np.array(
    [(30.0 + SPACING_PX * x + 0.37 * y, 30.3 + SPACING_PX * y) for y in range(3) for x in range(5)]
)
HEIGHT, WIDTH = 140, 220
GLARE_PX = PLACES[7, 0] + 3.0  # its border


def draw(light, noise=2.0, seed=0, *, evenly_lit=False):
    """Draw cyan balls on grey skin: twice as fine, blurred, cut off at 255, with noise.

    evenly_lit: each ball has the light of its centre, and the skin about it is brighter on one side.
    """
    rows, columns = (np.mgrid[: 2 * HEIGHT, : 2 * WIDTH] + 0.5) / 2 - 0.5
    bead = np.zeros((2 * HEIGHT, 2 * WIDTH))
    for x, y in PLACES:
        bead = np.maximum(bead, np.clip(DIAMETER_PX / 2 + 0.5 - np.hypot(columns - x, rows - y), 0, 1))
    bead = cv2.resize(bead, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    colour = light[..., None] * (1 - bead[..., None]) * SKIN
    on_bead = light.copy()
    if evenly_lit:
        for x, y in np.rint(PLACES).astype(int):
            on_bead[y - 10 : y + 11, x - 10 : x + 11] = light[y, x]
    colour += on_bead[..., None] * bead[..., None] * BEAD
    picture = np.minimum(cv2.GaussianBlur(colour, (0, 0), 1.5), 255)
    picture += np.random.default_rng(seed).normal(0, noise, picture.shape)
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def even(grey):
    return np.full((HEIGHT, WIDTH), float(grey))


def half_in_glare(added=140.0):
    """Light of 140 with a saturated half, whose border passes through the beads of one column."""
    columns = np.arange(WIDTH) - GLARE_PX
    return np.broadcast_to(140.0 + added / (1.0 + np.exp(-columns / 6.0)), (HEIGHT, WIDTH))


@pytest.fixture(scope="module")
def fit():
    return SymmetricFit(np.full(len(PLACES), DIAMETER_PX), np.full(len(PLACES), SPACING_PX))


def errors_px(places):
    return np.linalg.norm(places - PLACES, axis=1)


def test_the_border_of_glare_does_not_displace_a_bead(fit):
    picture = draw(half_in_glare())
    at_border = np.flatnonzero(np.abs(PLACES[:, 0] - GLARE_PX) < 4)
    centroid = Refiner(np.full(len(PLACES), DIAMETER_PX)).refine(plane(picture, BLUE_RED), PLACES).position_px
    fit.load(picture)
    fitted = fit.measure(PLACES + 0.4, np.arange(len(PLACES)))
    off_px = np.median(errors_px(fitted.position_px)[at_border])
    assert off_px < 0.1
    assert off_px < 0.5 * np.median(errors_px(centroid)[at_border])


@pytest.mark.parametrize("angle", [0.0, 2.0])
def test_evenly_lit_beads_on_unevenly_lit_skin(angle):
    """The skin's slope goes on under a bead in the drawing of a sloped light only."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    along = np.cos(angle) * (columns - WIDTH / 2) + np.sin(angle) * (rows - HEIGHT / 2)
    picture = draw(90.0 * np.exp(along / 150.0), noise=1.0, evenly_lit=True)
    sizes = np.full(len(PLACES), DIAMETER_PX), np.full(len(PLACES), SPACING_PX)
    off_px = []
    for way in (SymmetricFit(*sizes, BOTH_FIT, light) for light in (EVEN_LIGHT, SLOPED_LIGHT)):
        way.load(picture)
        places = way.measure(PLACES + 0.3, np.arange(len(PLACES))).position_px
        off_px.append(np.median(errors_px(places)))
    assert off_px[0] < 0.06
    assert off_px[0] < 0.6 * off_px[1]


def test_the_standard_deviation_grows_as_the_errors_of_clipped_beads(fit):
    """Clipped pixels show no noise: the residuals of the fit alone promise too much there."""
    error, sigma = [], []
    for grey in (130, 330):
        offs, sigmas = [], []
        for seed in range(6):
            picture = draw(even(grey), noise=0.0, seed=seed)
            _, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 60])
            fit.load(cv2.imdecode(data, cv2.IMREAD_COLOR))
            fitted = fit.measure(PLACES + 0.3, np.arange(len(PLACES)))
            offs.append(errors_px(fitted.position_px))
            sigmas.append(fitted.sigma_px)
        error.append(np.sqrt(np.mean(np.square(offs))))
        sigma.append(np.median(sigmas))
    assert sigma[1] / sigma[0] > 0.5 * error[1] / error[0]


def test_the_standard_deviation_grows_as_the_errors_in_dim_light(fit):
    """With the same noise on less contrast both grow as one over the contrast."""
    error, sigma = [], []
    for grey in (120, 40):
        fit.load(draw(even(grey), noise=5.0))
        fitted = fit.measure(PLACES - 0.3, np.arange(len(PLACES)))
        error.append(np.sqrt(np.mean(errors_px(fitted.position_px) ** 2)))
        sigma.append(np.median(fitted.sigma_px))
    assert sigma[1] / sigma[0] == pytest.approx(120 / 40, rel=0.2)
    assert error[1] / error[0] == pytest.approx(120 / 40, rel=0.5)


def test_a_few_beads_are_measured_as_all_are(fit):
    fit.load(draw(half_in_glare()))
    all_of_them = fit.measure(PLACES, np.arange(len(PLACES)))
    some = np.array([2, 7, 12])
    few = fit.measure(PLACES[some], some)
    assert np.allclose(few.position_px, all_of_them.position_px[some], atol=1e-3)
    assert np.allclose(few.sigma_px, all_of_them.sigma_px[some], rtol=1e-3)


def test_beads_at_the_border_of_glare_are_found_with_a_colour_image(fit):
    """On one channel alone such beads are lost. Their places count less the stronger the glare is."""
    one = np.ones(len(PLACES))
    fit.load(draw(even(140)))
    sigma_px = float(np.median(fit.measure(PLACES, np.arange(len(PLACES))).sigma_px))
    refined = Refiner(np.full(len(PLACES), DIAMETER_PX)).refine(plane(draw(even(140)), BLUE_RED), PLACES)
    reference = Reference(
        PLACES, DIAMETER_PX * one, refined.contrast, refined.area, None, refined.unevenness, sigma_px
    )
    picture = draw(half_in_glare(220.0))
    beads = Tracker(reference).follow(plane(picture, BLUE_RED), picture)
    without = Tracker(replace(reference, fit_sigma_px=None)).follow(plane(picture, BLUE_RED))
    assert beads.found_count > without.found_count
    assert beads.noise is not None
    at_border = np.abs(PLACES[:, 0] - GLARE_PX) < 4
    assert beads.found[at_border].all()
    assert (errors_px(beads.position_px)[beads.found] < 1.5).all()
    assert (beads.noise[at_border] > 5).all()
    assert (beads.noise[PLACES[:, 0] < GLARE_PX - 20] < 1.5).all()


@pytest.mark.parametrize("channels", [COLOUR_FIT, BOTH_FIT])
@pytest.mark.parametrize("is_rest", [True, False])
def test_one_halved_image_serves_all_stages(channels, is_rest):
    """The beads stand where they were drawn, as from the whole-size plane, with and without a search."""
    one = np.ones(len(PLACES))
    picture = draw(even(140))
    refined = Refiner(np.full(len(PLACES), DIAMETER_PX)).refine(plane(picture, BLUE_RED), PLACES)
    rest_px = PLACES + (0.5 if is_rest else 0.3 * SPACING_PX)  # the latter is too far off for windows
    reference = Reference(
        rest_px, DIAMETER_PX * one, refined.contrast, refined.area, fit_sigma_px=0.1, fit_channels=channels
    )
    beads = Tracker(reference).follow_image(picture, BLUE_RED)
    whole = Tracker(reference).follow(plane(picture, BLUE_RED), picture)
    assert beads.searched is not is_rest
    assert np.array_equal(beads.found, whole.found)
    assert np.median(errors_px(beads.position_px)) < 0.1
    assert np.abs(beads.position_px - whole.position_px)[beads.found].max() < 0.05
