"""Beads of one picture without a layout: all of them where there are some, none where there are none."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from palpate_edge.cli.main import cli
from palpate_edge.common.errors import CalibrationError, DatasetError
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.geometry.sensor import Camera, Dome, Markers, Sensor, View, bead_layout_mm
from palpate_edge.vision.registration import register
from palpate_edge.vision.unknown_layout import beads_without_layout

HEIGHT, WIDTH = 480, 640
ROW, COLUMN = np.mgrid[:HEIGHT, :WIDTH]


def noisy(picture, sigma=2.0):
    return np.clip(picture + np.random.default_rng(1).normal(0, sigma, picture.shape), 0, 255).astype(
        np.uint8
    )


def text(size, thickness, line):
    page = np.full((HEIGHT, WIDTH), 240, np.uint8)
    for row in range(40, HEIGHT, line):
        letters = "the quick brown fox jumps over the lazy dog 0123456789"[row % 5 :]
        cv2.putText(page, letters, (10, row), cv2.FONT_HERSHEY_COMPLEX, size, 20, thickness, cv2.LINE_AA)
    return noisy(page)


def hello(size, thickness):
    page = np.full((HEIGHT, WIDTH), 255, np.uint8)
    return cv2.putText(page, "hello", (100, 280), cv2.FONT_HERSHEY_SIMPLEX, size, 0, thickness)


def noise(sigma_px, colour=False):
    picture = np.random.default_rng(2).normal(0, 1, (HEIGHT, WIDTH, 3) if colour else (HEIGHT, WIDTH))
    if sigma_px:
        picture = cv2.GaussianBlur(picture, (0, 0), sigma_px)
    return np.clip(128 + 50 * picture / picture.std(), 0, 255).astype(np.uint8)


def keyboard(pitch, gap, keys, letters):
    picture = np.full((HEIGHT, WIDTH), 255 - keys, np.uint8)
    for row in range(HEIGHT // pitch - 1):
        for column in range(WIDTH // pitch - 1):
            x, y = 10 + column * pitch + row % 3 * pitch // 4, 10 + row * pitch
            cv2.rectangle(picture, (x, y), (x + pitch - gap, y + pitch - gap), keys, -1)
            letter = chr(65 + (7 * row + column) % 26)
            cv2.putText(picture, letter, (x + 4, y + pitch // 2), 0, pitch / 70, letters, 1, cv2.LINE_AA)
    return noisy(cv2.GaussianBlur(picture, (0, 0), 0.8))


def checkerboard(side):
    return (40 + 180 * ((ROW // side + COLUMN // side) % 2)).astype(np.uint8)


def lines():
    picture, random = np.full((HEIGHT, WIDTH), 128, np.uint8), np.random.default_rng(3)
    for x1, y1, x2, y2, grey, width in random.integers(
        (0,) * 5 + (1,), (WIDTH, HEIGHT, WIDTH, HEIGHT, 255, 5), (60, 6)
    ):
        cv2.line(picture, (int(x1), int(y1)), (int(x2), int(y2)), int(grey), int(width))
    return picture


NO_BEADS = {
    "black": lambda: np.zeros((HEIGHT, WIDTH), np.uint8),
    "wall": lambda: noisy(90 + 80 * COLUMN / WIDTH + 20 * ROW / HEIGHT, 3.0),
    "gradient": lambda: (255 * COLUMN / WIDTH).astype(np.uint8),
    "vignette": lambda: noisy(220 * np.exp(-((COLUMN - 320) ** 2 + (ROW - 240) ** 2) / 80_000)),
    "hello": lambda: hello(2, 3),
    "large hello": lambda: hello(5, 12),
    "small text": lambda: text(0.5, 1, 22),
    "text": lambda: text(0.8, 2, 36),
    "large text": lambda: text(1.5, 3, 60),
    "white noise": lambda: noise(0),
    "fine noise": lambda: noise(2),
    "noise": lambda: noise(4),
    "coarse noise": lambda: noise(7),
    "coloured noise": lambda: noise(4, colour=True),
    "dark keyboard": lambda: keyboard(40, 6, 40, 230),
    "light keyboard": lambda: keyboard(30, 4, 220, 20),
    "checkerboard 8": lambda: checkerboard(8),
    "checkerboard 16": lambda: noisy(checkerboard(16), 4.0),
    "checkerboard 32": lambda: checkerboard(32),
    "stripes": lambda: (127 + 100 * np.sin(COLUMN / 5)).astype(np.uint8),
    "rings": lambda: (127 + 100 * np.sin(np.hypot(COLUMN - 320, ROW - 240) / 6)).astype(np.uint8),
    "lines": lines,
}


@pytest.mark.parametrize("name", NO_BEADS)
@pytest.mark.long
def test_a_picture_without_beads_has_none(name):
    blobs, _, _ = beads_without_layout(NO_BEADS[name]())
    assert len(blobs.strength) == 0


@pytest.mark.parametrize("command", ["inspect", "follow"])
@pytest.mark.parametrize("name", ["hello", "noise", "dark keyboard", "wall"])
def test_the_commands_say_no_beads_and_fail(tmp_path, command, name):
    (tmp_path / "frames").mkdir()
    frame = tmp_path / "frames" / "0.png"
    assert cv2.imwrite(str(frame), NO_BEADS[name]())
    given = frame if command == "inspect" else frame.parent
    with pytest.raises(DatasetError, match="no beads found") as refused:
        cli.main([command, str(given), "-o", str(tmp_path / "out.png")], standalone_mode=False)
    assert refused.value.exit_status == 3
    assert not (tmp_path / "out.png").exists()


OVEREXPOSED = {("press-hard", 5), ("press-hard", 7)}  # most of the dome is white


@pytest.mark.parametrize(("dataset", "shown"), [("press-hard", 0.7), ("press-sample", 1.0)])
@pytest.mark.parametrize("number", range(8))
@pytest.mark.long
def test_beads_of_the_twins_sensors_and_no_reflection_of_a_lamp(shared_data, dataset, shown, number):
    """The drawing gives the places of the beads: in colour, and under overexposed patches of light."""
    data = read_dataset(shared_data(dataset))
    blobs, _, _ = beads_without_layout(read_image(data.reference[number]))
    drawn_px = View(data.sensor.camera).project(bead_layout_mm(data.sensor.markers)[0])
    apart = np.linalg.norm(blobs.position_px[:, None] - drawn_px[None], axis=2)
    shift = np.median(blobs.position_px - drawn_px[apart.argmin(axis=1)], axis=0)
    apart = np.linalg.norm(blobs.position_px[:, None] - shift - drawn_px[None], axis=2)
    assert (apart.min(axis=1) < 8).mean() > 0.97
    least = 0.4 if (dataset, number) in OVEREXPOSED else shown
    assert len(np.unique(apart.argmin(axis=1))) >= least * len(drawn_px)


def test_a_reflection_of_lamps_is_not_taken_for_the_beads():
    """Seven white spots, brighter and sharper than the 48 grey-blue beads around them."""
    picture = np.full((HEIGHT, WIDTH, 3), (60, 70, 90), np.float64)
    beads = [(60 + 74 * column, 50 + 76 * row) for row in range(6) for column in range(8)]
    for place in beads:
        cv2.circle(picture, place, 9, (130, 120, 90), -1, cv2.LINE_AA)
    for lamp in range(7):
        x, y = 320 + 22 * np.cos(lamp * 0.9), 240 + 22 * np.sin(lamp * 0.9)
        cv2.circle(picture, (round(x), round(y)), 3, (255, 255, 255), -1, cv2.LINE_AA)
    blobs, _, _ = beads_without_layout(noisy(cv2.GaussianBlur(picture, (0, 0), 1.0)))
    apart = np.linalg.norm(blobs.position_px[:, None] - np.array(beads, dtype=float)[None], axis=2)
    assert (apart.min(axis=1) < 2).all()
    assert len(blobs.strength) >= 42  # a lamp hides the nearest ones' edges


HEXAGON = np.array(
    [
        (320 + 34 * (column + row / 2), 240 + 34 * np.sqrt(0.75) * row)
        for row in range(-6, 7)
        for column in range(-6, 7)
        if abs(row + column) <= 6
    ]
)


def lattice(colour, skin=120.0, light=1.0, reflection_px=0, oval_from=127):
    """A hexagon of 127 beads, 15 px wide, on grey skin; light: factor of each pixel."""
    picture = np.full((HEIGHT, WIDTH, 3), skin)
    for number, (x, y) in enumerate(HEXAGON):
        place, width = (round(16 * x), round(16 * y)), 120 if number < oval_from else 60
        cv2.ellipse(picture, place, (120, width), 30.0, 0.0, 360.0, colour, -1, cv2.LINE_AA, 4)
        cv2.circle(picture, place, 8 * reflection_px, (255, 255, 255), -1, cv2.LINE_AA, 4)
    return noisy(cv2.GaussianBlur(light * picture, (0, 0), 1.0))


def apart_px(position_px):
    return np.linalg.norm(position_px[:, None] - HEXAGON[None], axis=2).min(axis=1)


def test_beads_with_a_reflection_in_the_middle_are_all_found():
    blobs, appearance, diameter_px = beads_without_layout(lattice((40, 40, 40), skin=200.0, reflection_px=5))
    assert len(blobs.strength) == len(HEXAGON)
    assert (apart_px(blobs.position_px) < 2).all()
    assert not appearance.bright  # then they would be the reflections
    assert diameter_px == pytest.approx(15.0, rel=0.1)


def test_a_colour_is_preferred_to_grey_with_patches_of_light():
    light = np.ones((HEIGHT, WIDTH))
    for x, y in np.random.default_rng(3).uniform((150, 60), (490, 420), (40, 2)):
        light += 0.15 * np.exp(-((COLUMN - x) ** 2 + (ROW - y) ** 2) / (2 * 6.0**2))
    blobs, appearance, _ = beads_without_layout(lattice((170, 165, 90), light=light[:, :, None]))
    assert appearance.channel != "grey"
    assert len(blobs.strength) == len(HEXAGON)


WITHOUT_RINGS = Sensor(
    Dome(30.0, 5.0),
    Markers(26.5, 2.8, ()),
    Camera(WIDTH, HEIGHT, (380.0, 380.0, 320.0, 240.0), (0.0, 0.0, -45.0)),
)


def test_beads_that_are_all_recognised_make_a_layout():
    assert len(register(lattice((40, 40, 40)), WITHOUT_RINGS).layout_mm) == len(HEXAGON)


def test_a_layout_is_not_learned_from_half_of_the_beads():
    with pytest.raises(CalibrationError, match=r"\d+ beads were found .* among them \d+ other spots"):
        register(lattice((40, 40, 40), oval_from=64), WITHOUT_RINGS)
