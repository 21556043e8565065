"""Finding and refining beads: places against the truth that the picture was drawn from."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.inspect import beads_without_layout
from palpate_edge.markers import Appearance, Refiner, find_blobs, plane

DARK = {"bead_bgr": (30, 30, 30), "skin_bgr": (150, 155, 165)}
BRIGHT = {"bead_bgr": (235, 240, 240), "skin_bgr": (110, 105, 115)}
RED = {"bead_bgr": (60, 60, 220), "skin_bgr": (120, 125, 125)}
LOOKS = [
    pytest.param(DARK, Appearance("grey", bright=False), id="dark"),
    pytest.param(BRIGHT, Appearance("grey", bright=True), id="bright"),
    pytest.param(RED, Appearance("blue-red", bright=False), id="red"),
]


@pytest.fixture(scope="module")
def scattered(another_dome):
    """40 beads of 12 px at random sub-pixel places, 30 px apart: the places and a way to draw them."""
    random = np.random.default_rng(5)
    cells = np.stack(np.meshgrid(np.arange(8), np.arange(5)), axis=-1).reshape(-1, 2)
    places = 55 + 30 * cells + random.uniform(-4, 4, (40, 2))

    def draw(noise=0.0, **colours):
        dome = another_dome(width=320, height=240, noise=noise, **colours)
        return dome.draw(places, np.full(40, 12.0), seed=7)

    return places, draw


@pytest.mark.parametrize(("colours", "appearance"), LOOKS)
def test_refined_centres_lie_on_the_drawn_places(scattered, colours, appearance):
    places, draw = scattered
    start = places + np.random.default_rng(1).uniform(-2, 2, places.shape)
    refined = Refiner(np.full(40, 12.0)).refine(plane(draw(**colours), appearance), start)
    assert np.linalg.norm(refined.position_px - places, axis=1).max() < 0.08  # the shading pulls it a little
    assert refined.settled.all()
    assert (np.abs(refined.area - 1) < 0.2).all()


@pytest.mark.parametrize(("colours", "appearance"), LOOKS)
def test_noise_of_two_grey_levels_costs_less_than_a_tenth_of_a_pixel(scattered, colours, appearance):
    places, draw = scattered
    refined = Refiner(np.full(40, 12.0)).refine(plane(draw(noise=2.0, **colours), appearance), places)
    error = np.linalg.norm(refined.position_px - places, axis=1)
    assert np.sqrt((error**2).mean()) < 0.05
    assert error.max() < 0.12


@pytest.mark.parametrize(("colours", "appearance"), LOOKS)
def test_the_strongest_blobs_are_the_beads_and_nothing_else(scattered, colours, appearance):
    places, draw = scattered
    blobs = find_blobs(plane(draw(noise=2.0, **colours), appearance), 12.0)
    strongest = blobs.position_px[:40]
    distance = np.linalg.norm(strongest[:, None] - places[None], axis=2)
    assert (distance.min(axis=0) < 1.5).all()  # every bead has a blob
    assert (distance.min(axis=1) < 1.5).all()  # every blob is a bead
    assert (blobs.strength[40:] < blobs.strength[39] / 3).all()


def test_contrast_is_the_drawn_difference_in_grey_levels(another_dome):
    dome = another_dome(noise=0.0, skin_bgr=(120, 120, 120), bead_bgr=(40, 40, 40))
    middle = np.array([[160.3, 120.6]])
    frame = np.array([[60.0, 120.0], [260.0, 120.0]])  # far beads that make the skin large
    picture = dome.draw(np.concatenate([middle, frame]), np.full(3, 14.0), seed=1)
    refined = Refiner(np.full(1, 14.0)).refine(plane(picture, Appearance()), middle)
    assert refined.contrast[0] == pytest.approx(120 + 12 - 40, abs=3)


def test_a_start_at_the_border_has_no_contrast_and_stays(scattered):
    _, draw = scattered
    starts = np.array([[1.0, 120.0], [160.0, 239.0], [-30.0, 500.0]])
    refined = Refiner(np.full(3, 12.0)).refine(plane(draw(**DARK), Appearance()), starts)
    assert refined.contrast.tolist() == [0, 0, 0]
    assert refined.position_px.tolist() == starts.tolist()


def test_a_blank_picture_has_no_blob():
    blank = np.full((240, 320), 90, dtype=np.uint8)
    assert len(find_blobs(plane(blank, Appearance()), 12.0).strength) == 0


@pytest.mark.parametrize("bright", [False, True])
def test_a_straight_edge_is_no_blob(bright):
    step = np.full((240, 320), 60, dtype=np.uint8)
    step[:, 150:] = 190
    assert len(find_blobs(plane(step, Appearance("grey", bright)), 12.0).strength) == 0


@pytest.mark.parametrize(("colours", "bright"), [(DARK, False), (BRIGHT, True)], ids=["dark", "bright"])
def test_beads_are_counted_without_a_layout(another_dome, colours, bright):
    dome = another_dome(**colours)
    blobs, appearance, _ = beads_without_layout(dome.picture(dome.beads_mm(), seed=3))
    assert len(blobs.strength) == 85
    assert appearance.bright == bright
