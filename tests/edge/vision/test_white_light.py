"""Beads in white light, of which only a faint ring is left: cyan disks, drawn; one of them is changed."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from palpate_edge.vision.appearance import Appearance, plane
from palpate_edge.vision.beads import BOTH_FIT, Reference
from palpate_edge.vision.subpixel import Refiner
from palpate_edge.vision.symmetric_fit import SymmetricFit
from palpate_edge.vision.tracker import Tracker

BLUE_RED = Appearance("blue-red", bright=True)
DIAMETER_PX, SPACING_PX = 16.0, 44.0
PLACES = np.array(
    [(40.0 + SPACING_PX * x + 0.4 * y, 40.3 + SPACING_PX * y) for y in range(4) for x in range(5)]
)
HEIGHT, WIDTH = 214, 258
CHANGED = 7
SKIN, BEAD, WHITE, FAINT = (
    (150.0, 148.0, 140.0),
    (220.0, 205.0, 95.0),
    (255.0, 255.0, 255.0),
    (255.0, 252.0, 236.0),
)


def draw(ring_px=None, jpeg_quality=60):
    """Draw the beads; ring_px: the changed one is a faint ring there in white light, `None`: like the others,
    `()`: hidden in white light."""
    picture = np.full((4 * HEIGHT, 4 * WIDTH, 3), SKIN)
    for number, place in enumerate(PLACES):
        if number != CHANGED or ring_px is None:
            disk(picture, place, DIAMETER_PX / 2, BEAD)
    if ring_px is not None:
        disk(picture, PLACES[CHANGED], 24.0, WHITE)
    if ring_px is not None and len(ring_px):
        disk(picture, ring_px, DIAMETER_PX / 2, FAINT)
        disk(picture, ring_px, DIAMETER_PX / 4, WHITE)
    small = cv2.GaussianBlur(cv2.resize(picture, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA), (0, 0), 1.0)
    small[small < 254] += np.random.default_rng(0).normal(0, 2.0, small.shape)[small < 254]
    small = np.clip(np.rint(small), 0, 255).astype(np.uint8)
    _, data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality])
    return cv2.imdecode(data, cv2.IMREAD_COLOR)


def disk(picture, place_px, radius_px, colour):
    """Fill a disk, four times as fine as the picture's pixels."""
    centre = np.rint((np.asarray(place_px) + 0.5) * 4 * 16 - 8).astype(int).tolist()
    cv2.circle(picture, centre, round(radius_px * 4 * 16), colour, -1, cv2.LINE_8, shift=4)


@pytest.fixture(scope="module")
def reference():
    one, every = np.ones(len(PLACES)), np.arange(len(PLACES))
    picture = draw()
    refined = Refiner(DIAMETER_PX * one).refine(plane(picture, BLUE_RED), PLACES)
    fit = SymmetricFit(DIAMETER_PX * one, SPACING_PX * one, BOTH_FIT)
    fit.load(picture)
    sigma_px = float(np.median(fit.measure(PLACES, every).sigma_px))
    return Reference(
        PLACES,
        DIAMETER_PX * one,
        refined.contrast,
        refined.area,
        None,
        refined.unevenness,
        sigma_px,
        BOTH_FIT,
    )


@pytest.mark.parametrize("off_px", [(0.0, 0.0), (1.2, -0.9)])
def test_a_faint_ring_in_white_light_is_a_bead(reference, off_px):
    ring_px = PLACES[CHANGED] + off_px
    beads = Tracker(reference).follow_image(draw(ring_px), BLUE_RED)
    assert beads.found[CHANGED]
    assert np.linalg.norm(beads.position_px[CHANGED] - ring_px) < 1.0
    assert beads.noise is not None
    assert beads.noise[CHANGED] > 3


def test_a_hidden_bead_in_white_light_is_not_found(reference):
    beads = Tracker(reference).follow_image(draw(()), BLUE_RED)
    assert beads.lost.tolist() == [CHANGED]


def test_the_explained_share_tells_beads_from_skin_and_rings_from_white_light():
    one = np.ones(len(PLACES))
    fit = SymmetricFit(DIAMETER_PX * one, SPACING_PX * one, BOTH_FIT)
    fit.load(draw(PLACES[CHANGED]))
    beads = fit.measure(PLACES, np.arange(len(PLACES)))
    others = np.arange(len(PLACES)) != CHANGED
    assert (beads.explained[others] > 0.9).all()
    assert beads.explained[CHANGED] > 0.55
    assert beads.clipped[CHANGED] > 0.75
    between_px = PLACES[:14] + 0.5 * SPACING_PX
    between_px = between_px[np.linalg.norm(between_px - PLACES[CHANGED], axis=1) > 40]
    assert (fit.measure(between_px, np.arange(len(between_px))).explained < 0.5).all()
    fit.load(draw(()))
    assert fit.measure(PLACES[[CHANGED]], np.array([CHANGED])).explained[0] < 0.1
