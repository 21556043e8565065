"""The choice of how places are measured, on drawn disks in light that is even or changes."""

from __future__ import annotations

import cv2
import numpy as np

from palpate_edge.calibration.fit_choice import choose_fit
from palpate_edge.vision.appearance import Appearance, plane
from palpate_edge.vision.beads import EVEN_LIGHT, GREY_FIT, Reference
from palpate_edge.vision.subpixel import Refiner
from palpate_edge.vision.tracker import Tracker

GREY = Appearance("grey", bright=False)
DIAMETER_PX = 16.0
PLACES = np.array([(40.0 + 40 * x + 0.37 * y, 40.3 + 40 * y) for y in range(3) for x in range(5)])
HEIGHT, WIDTH = 160, 240
ROWS, COLUMNS = np.mgrid[:HEIGHT, :WIDTH].astype(float)
APART_PX = np.min([np.hypot(COLUMNS - x, ROWS - y) for x, y in PLACES], axis=0)
DISKS = cv2.GaussianBlur(np.clip(DIAMETER_PX / 2 + 0.5 - APART_PX, 0, 1), (0, 0), 1.2)


def draw(slope: float, rng: np.random.Generator) -> np.ndarray:
    """Draw disks of 60 % of the skin's grey. slope: growth of the light from left to right, in grey levels a
    pixel."""
    light = 140 + slope * (COLUMNS - WIDTH / 2)
    picture = (1 - 0.4 * DISKS) * light + rng.normal(0, 2, DISKS.shape)
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def chosen(slopes: list[float]) -> tuple[Reference, list[np.ndarray]]:
    rng = np.random.default_rng(1)
    images = [draw(slope, rng) for slope in slopes]
    one = np.ones(len(PLACES))
    refined = Refiner(DIAMETER_PX * one).refine(plane(draw(0.0, rng), GREY), PLACES)
    reference = Reference(PLACES, DIAMETER_PX * one, refined.contrast, refined.area, None, refined.unevenness)
    return choose_fit(reference, GREY, images, images), images


def test_centroids_where_light_is_even() -> None:
    assert chosen([0.0] * 8)[0].fit_sigma_px is None


def test_symmetry_on_grey_where_light_changes() -> None:
    """The slope of the light moves a plain centroid and not the centre of symmetry, also in a grey image."""
    reference, images = chosen([-0.6, 0.5, 0.0, 0.6, -0.3, 0.4, -0.6, 0.2])
    assert reference.fit_channels == GREY_FIT
    tracker = Tracker(reference)
    for image in (images[0], cv2.cvtColor(images[0], cv2.COLOR_GRAY2BGR)):
        tracker.reset()
        beads = tracker.follow(plane(image, GREY), image)
        assert beads.found.all()
        assert np.median(np.linalg.norm(beads.position_px - PLACES, axis=1)) < 0.1
    plain = Refiner(np.full(len(PLACES), DIAMETER_PX)).refine(images[0], PLACES)
    assert np.median(np.linalg.norm(plain.position_px - PLACES, axis=1)) > 0.15


def test_a_sensor_without_frames_that_show_beads_keeps_centroids() -> None:
    one = np.ones(len(PLACES))
    reference = Reference(PLACES, DIAMETER_PX * one, 60 * one, one, None, 0.1 * one)
    blank = [np.full((HEIGHT, WIDTH), 128, np.uint8)]
    assert choose_fit(reference, GREY, blank, blank).fit_sigma_px is None


def test_even_light_where_beads_do_not_share_the_light_of_the_skin() -> None:
    """The same disks, each in the light of its centre, while the slope of the skin's light changes."""
    rng = np.random.default_rng(2)
    nearest = PLACES[np.argmin([np.hypot(COLUMNS - x, ROWS - y) for x, y in PLACES], axis=0)]
    images = []
    for slope in (-0.6, 0.5, 0.0, 0.6, -0.3, 0.4, -0.6, 0.2):
        on_skin, on_bead = (140 + slope * (x - WIDTH / 2) for x in (COLUMNS, nearest[..., 0]))
        picture = (1 - DISKS) * on_skin + 0.6 * DISKS * on_bead + rng.normal(0, 2, DISKS.shape)
        images.append(np.clip(np.rint(picture), 0, 255).astype(np.uint8))
    one = np.ones(len(PLACES))
    refined = Refiner(DIAMETER_PX * one).refine(plane(images[2], GREY), PLACES)
    reference = Reference(PLACES, DIAMETER_PX * one, refined.contrast, refined.area, None, refined.unevenness)
    assert choose_fit(reference, GREY, images, images).fit_light == EVEN_LIGHT
