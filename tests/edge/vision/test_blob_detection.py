"""Blob detection and sub-pixel places, compared with the places that the picture was drawn from."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from palpate_edge.vision.appearance import Appearance, plane, unlit_grey
from palpate_edge.vision.binning import halved
from palpate_edge.vision.blob_detection import BlobDetector, find_blobs
from palpate_edge.vision.shading import Shading, skin_slope
from palpate_edge.vision.subpixel import Refiner
from palpate_edge.vision.unknown_layout import beads_without_layout

DARK = {"bead_bgr": (30, 30, 30), "skin_bgr": (150, 155, 165)}
BRIGHT = {"bead_bgr": (235, 240, 240), "skin_bgr": (110, 105, 115)}
RED = {"bead_bgr": (60, 60, 220), "skin_bgr": (120, 125, 125)}
LOOKS = [
    pytest.param(DARK, Appearance("grey", bright=False), id="dark"),
    pytest.param(BRIGHT, Appearance("grey", bright=True), id="bright"),
    pytest.param(RED, Appearance("blue-red", bright=False), id="red"),
]


def disks(places, diameters, shape, slope=(0.0, 0.0), blur=0.7, noise=0.0, seed=0, skin=150, bead=None):
    """Disks (n, 2), (n,) on skin, each pixel the mean of 16 x 16 points of an exact scene; slope: grey levels
    by which the skin brightens from pixel to pixel; bead: its brightness over the skin's in the same light,
    None for a flat 50."""
    fine = 16
    height, width = shape
    row, column = ((np.arange(size * fine) + 0.5) / fine - 0.5 for size in shape)
    light = skin + slope[0] * (column - width / 2) + slope[1] * (row[:, None] - height / 2)
    scene = light.copy()
    for (x, y), diameter in zip(places, diameters, strict=True):
        rows, columns = (
            slice(*np.searchsorted(at, middle + np.array([-diameter, diameter])))
            for at, middle in ((row, y), (column, x))
        )
        inside = np.hypot(column[columns] - x, row[rows, None] - y) < diameter / 2
        scene[rows, columns][inside] = 50 if bead is None else bead * light[rows, columns][inside]
    picture = scene.reshape(height, fine, width, fine).mean(axis=(1, 3))
    picture = cv2.GaussianBlur(picture, (0, 0), blur)
    noisy = picture + noise * np.random.default_rng(seed).standard_normal(shape)
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


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
    assert np.linalg.norm(refined.position_px - places, axis=1).max() < 0.1  # the shading pulls it a little
    assert refined.converged.all()
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


STRESS = [
    pytest.param({"noise": 2.0}, 0.05, id="noise-2"),
    pytest.param({"noise": 8.0}, 0.1, id="noise-8"),
    pytest.param({"noise": 2.0, "slope": (0.5, -0.2)}, 0.05, id="slope"),
    pytest.param({"noise": 2.0, "slope": (0.5, -0.2), "blur": 1.7}, 0.05, id="slope-and-blur"),
]


@pytest.mark.parametrize(("harm", "limit_px"), STRESS)
@pytest.mark.parametrize("diameter_px", [9.0, 12.5, 18.0])
def test_exact_disks_are_found_to_a_twentieth_of_a_pixel(diameter_px, harm, limit_px):
    """The goal: median error at most 0.05 px, 0.1 px under stress."""
    random = np.random.default_rng(11)
    cells = np.stack(np.meshgrid(np.arange(6), np.arange(4)), axis=-1).reshape(-1, 2)
    places = 30 + 40 * cells + random.uniform(-4, 4, cells.shape)
    sizes, shape = np.full(len(places), diameter_px), (180, 260)
    slope = np.asarray(harm.get("slope", (0.0, 0.0)))
    away = places - np.array([shape[1], shape[0]]) / 2
    relative = slope / (100 + away @ slope)[:, None]  # over the contrast there
    picture = disks(places, sizes, shape, **harm)
    start = places + random.uniform(-0.15, 0.15, places.shape) * diameter_px
    refined = Refiner(sizes, None, Shading(relative, None)).refine(picture, start)
    assert np.median(np.linalg.norm(refined.position_px - places, axis=1)) < limit_px
    assert refined.converged.all()


@pytest.mark.parametrize(("skin", "bead"), [(140, 0.1), (140, 0.4), (60, 3.0), (90, 2.0)])
@pytest.mark.parametrize("blur", [0.7, 1.7])
@pytest.mark.parametrize("diameter_px", [9.0, 12.5, 18.0])
def test_a_bead_in_the_same_light_as_its_skin_is_where_it_was_drawn(diameter_px, blur, skin, bead):
    """Dark and light beads, whose own grey falls off as the skin's does."""
    places = np.array([[30.3, 30.8], [80.6, 31.1], [129.9, 30.4], [30.5, 80.2], [80.1, 80.7], [130.2, 80.5]])
    sizes, slope = np.full(len(places), diameter_px), np.array([0.3, -0.15])
    picture = disks(places, sizes, (110, 160), slope, blur, skin=skin, bead=bead)
    there = skin + (places - np.array([80, 55])) @ slope
    bright = bead > 1
    relative = (-slope if bright else slope) / (abs(1 - bead) * there)[:, None]
    appearance = Appearance("grey", bright)
    light = Shading(relative, unlit_grey(appearance))
    refined = Refiner(sizes, None, light).refine(plane(picture, appearance), places + 0.7)
    assert np.linalg.norm(refined.position_px - places, axis=1).max() < 0.05


def test_the_skins_slope_is_the_drawn_one():
    places = np.array([[40.3, 40.1], [90.2, 41.7], [65.5, 80.4]])
    sizes, slope = np.full(3, 14.0), (0.6, -0.3)
    picture = disks(places, sizes, (120, 130), slope=slope, noise=1.0)
    picture[48:52, 38:44] = 255  # a highlight
    found = skin_slope(picture, places, sizes, np.full(3, 48.0))
    assert found == pytest.approx(np.tile(slope, (3, 1)), abs=0.03)
    assert (skin_slope(picture, places, sizes, np.full(3, 17.0)) == 0).all()  # no skin between such beads


def test_contrast_is_the_drawn_difference_in_grey_levels(another_dome):
    dome = another_dome(noise=0.0, skin_bgr=(120, 120, 120), bead_bgr=(40, 40, 40))
    middle = np.array([[160.3, 120.6]])
    frame = np.array([[60.0, 120.0], [260.0, 120.0]])  # far beads that make the skin large
    picture = dome.draw(np.concatenate([middle, frame]), np.full(3, 14.0), seed=1)
    refined = Refiner(np.full(1, 14.0)).refine(plane(picture, Appearance()), middle)
    assert refined.contrast[0] == pytest.approx(120 + 12 - 40, abs=3)


def test_a_start_outside_the_picture_has_no_contrast_and_stays(scattered):
    _, draw = scattered
    starts = np.array([[-1.0, 120.0], [160.0, 240.0], [-30.0, 500.0]])
    refined = Refiner(np.full(3, 12.0)).refine(plane(draw(**DARK), Appearance()), starts)
    assert refined.contrast.tolist() == [0, 0, 0]
    assert refined.position_px.tolist() == starts.tolist()


@pytest.mark.parametrize("diameter_px", [8.0, 16.0])
def test_a_whole_bead_at_the_border_is_found_as_well_as_any(diameter_px):
    """A bead's window leaves the picture on one side, in the corners on two."""
    inset = 0.5 * diameter_px + 1.3
    low, high = np.array([inset, inset]), np.array([99, 79]) - inset
    places = np.array([low, high, (low[0], 40.2), (50.6, high[1]), (50.4, 39.7)])
    picture = disks(places, np.full(5, diameter_px), (80, 100))
    start = places + np.random.default_rng(4).uniform(-1.5, 1.5, places.shape)
    refined = Refiner(np.full(5, diameter_px)).refine(picture, np.maximum(start, 0))
    assert np.linalg.norm(refined.position_px - places, axis=1).max() < 0.1
    assert (refined.contrast > 60).all()


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


def test_a_halved_plane_shows_the_same_blobs(scattered):
    _, draw = scattered
    dark = plane(draw(noise=2.0, **DARK), Appearance()).astype(np.float32)
    halved_px = BlobDetector(12.0).find(halved(dark), halvings=1)
    whole_px = find_blobs(dark, 12.0)
    assert np.array_equal(halved_px.position_px, whole_px.position_px)
    assert np.array_equal(halved_px.strength, whole_px.strength)


@pytest.mark.parametrize("shape", [(6, 8), (7, 9), (7, 9, 3)])
def test_halved_pixels_are_means_of_two_by_two(shape):
    image = np.random.default_rng(0).integers(0, 256, shape).astype(np.float32)
    small = halved(image)
    assert small.shape[:2] == (3, 4)
    assert np.allclose(small[1, 2], image[2:4, 4:6].mean(axis=(0, 1)))


def test_a_detector_gives_the_same_blobs_after_planes_of_other_sizes_and_types(scattered):
    _, draw = scattered
    dark = plane(draw(noise=2.0, **DARK), Appearance())
    detector = BlobDetector(12.0)
    first = detector.find(dark)
    detector.find(dark[::-1])
    detector.find(dark[:60, :80].astype(np.float32))
    again = detector.find(dark)
    assert len(first.strength)
    assert (again.position_px == first.position_px).all()
    assert (again.strength == first.strength).all()


@pytest.mark.parametrize("apart_px", [19.0, 15.0, 14.0])
def test_a_coarse_search_finds_every_pin_of_a_dense_lattice(apart_px):
    """Pins of 12 px, pressed together until their edges almost touch."""
    column, row = np.meshgrid(np.arange(12), np.arange(12))
    places = 40.0 + apart_px * np.stack([column + 0.5 * (row % 2), 0.87 * row], axis=-1).reshape(-1, 2)
    picture = np.full((300, 320), 170, np.uint8)
    for x, y in np.rint(16 * places).astype(int).tolist():
        cv2.circle(picture, (x, y), 16 * 6, 70, cv2.FILLED, cv2.LINE_AA, shift=4)
    noise = np.random.default_rng(2).normal(0.0, 4.0, picture.shape)
    dark = np.clip(cv2.GaussianBlur(picture, (7, 7), 1.5) + noise, 0, 255).astype(np.uint8)
    blobs = BlobDetector(12.0, 10.0, coarse=True).find(dark)
    apart = np.linalg.norm(places[:, None] - blobs.position_px[None], axis=2)
    assert len(blobs.strength) == len(places)
    assert apart.min(axis=1).max() < 2.0


@pytest.mark.parametrize("coarse", [False, True])
def test_a_disk_whose_middle_lies_between_equal_pixels_is_one_blob(coarse):
    row, column = np.mgrid[0:96, 0:96]
    inside = np.hypot(column - 47.5, row - 47.5) < 7.0
    blobs = BlobDetector(14.0, coarse=coarse).find(np.where(inside, 40, 200).astype(np.uint8))
    np.testing.assert_allclose(blobs.position_px, [[47.5, 47.5]], atol=0.01)
