"""Processor time of whole estimates where finding the beads is easy and where it is not.

Stills (every frame is another press), sequences, hidden beads, a bead that is lost for good, jumps, hard
light, and 331 pins without a frame before. A frame's cost should not depend on luck: the column p99/median
shows it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import cv2
import numpy as np

from bench.estimator import FRAME_US
from bench.frames import JPEG_QUALITY, SHARED, calibrated, demo_material
from bench.timing import Row, table, time_both
from palpate_edge.common.arrays import Array, Image
from palpate_edge.common.frame import Frame
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.estimation.estimator import Estimator
from palpate_edge.vision.appearance import plane
from palpate_edge.vision.beads import Reference
from palpate_edge.vision.tracker import Tracker

HIDDEN_SHARE = 0.3
JUMP_EVERY, JUMP = 8, 97  # frames
PIN_SHELLS, PIN_SPACING_PX, PIN_DIAMETER_PX = 10, 19.0, 12.0
PIN_FRAMES = 40
DETECTOR_FRAMES = 40  # fewer frames because the alternative is slow

Jpegs = tuple[Image, ...]


@dataclass(frozen=True, slots=True)
class Case:
    """One row: a name, the calibration, and the frames as JPEG data."""

    name: str
    calibration: Calibration
    jpegs: Jpegs


def report() -> str:
    """Return the table; rows of the shared data are left out where it is not there."""
    sequence = _sequence()
    decoding_s, _ = time_both(lambda jpeg: _decode(jpeg, grey=True), lambda _: None, sequence.jpegs)
    rows = [Row("grey JPEG decoding (b)", decoding_s)]
    rows += [Row(case.name, _estimates_s(case)) for case in (sequence, *_harder(sequence), *_shared())]
    rows.append(Row("331 pins without a frame before: find and number", _pins_s()))
    detector = cv2.SimpleBlobDetector.create()
    _, detector_s = time_both(
        lambda jpeg: _decode(jpeg, grey=True), detector.detect, sequence.jpegs[:DETECTOR_FRAMES]
    )
    rows.append(Row("OpenCV's SimpleBlobDetector (a)", detector_s))
    title = "Estimates, image to force, processor time, one core"
    return table(title, rows, against=rows[-1], spread=True)


def _sequence() -> Case:
    folder = SHARED / "press-sequences" / "finger-1" / "frames"
    if not folder.is_dir():
        material = demo_material()
        return Case(material.name, material.calibration, material.jpegs)
    return Case("press-sequences/finger-1", calibrated(SHARED / "press-sample"), _files(folder))


def _harder(case: Case) -> Iterator[Case]:
    """Yield the sequence with hidden beads, and with jumps."""
    reference = case.calibration.reference()
    count_ = len(reference.position_px)
    some = np.random.default_rng(1).choice(count_, int(HIDDEN_SHARE * count_), replace=False)
    middle = np.argmin(np.linalg.norm(reference.position_px - reference.position_px.mean(axis=0), axis=1))
    yield Case("  30 % of the beads hidden", case.calibration, _hidden(case, some))
    yield Case("  one bead lost for good", case.calibration, _hidden(case, np.array([middle])))
    total = len(case.jpegs)
    order = [(number + JUMP * (number // JUMP_EVERY)) % total for number in range(total)]
    jumps = tuple(case.jpegs[number] for number in order)
    yield Case(f"  a jump every {JUMP_EVERY} frames", case.calibration, jumps)


def _shared() -> Iterator[Case]:
    if not (SHARED / "press-hard").is_dir():
        return
    yield Case("press-sample, stills", calibrated(SHARED / "press-sample"), _stills(SHARED / "press-sample"))
    hard = calibrated(SHARED / "press-hard")
    yield Case("press-hard, stills", hard, _stills(SHARED / "press-hard"))
    yield Case("press-hard-sequence", hard, _files(SHARED / "press-hard-sequence" / "frames"))


def _estimates_s(case: Case) -> Array:
    """Return the durations of the estimates, each right after decoding the frame."""
    estimator, number = Estimator(case.calibration), count()
    grey = case.calibration.appearance.channel == "grey"

    def estimate(image: Image) -> object:
        index = next(number)
        return estimator.estimate(Frame(image, index * FRAME_US, index, ""))

    return time_both(lambda jpeg: _decode(jpeg, grey=grey), estimate, case.jpegs)[1]


def _hidden(case: Case, beads: Array) -> Jpegs:
    """Return the frames with these beads painted over, wherever they move, in the grey beside them."""
    reference = case.calibration.reference()
    tracker = Tracker(reference)
    jpegs = []
    for jpeg in case.jpegs:
        image = _decode(jpeg, grey=True)
        place = tracker.follow(plane(image, case.calibration.appearance)).position_px
        for bead in beads:
            x, y = place[bead]
            radius = 0.75 * reference.diameter_px[bead]
            beside = image[round(y), min(round(x + radius), image.shape[1] - 1)]
            cv2.circle(image, (round(x), round(y)), round(radius), int(beside), cv2.FILLED)
        jpegs.append(np.asarray(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]))
    return tuple(jpegs)


def _pins_s() -> Array:
    """Return the durations for pictures of 331 pins, each displaced anew by up to a spacing."""
    tracker, random = Tracker(pins()), np.random.default_rng(1)

    def follow(picture: Image) -> object:
        tracker.reset()
        return tracker.follow(picture)

    def picture(_: int) -> Image:
        return drawn(pressed(random))

    return time_both(picture, follow, range(PIN_FRAMES))[1]


def pins() -> Reference:
    """Return 331 untouched pins: a hexagon of ten shells."""
    rest = _hexagon()
    everywhere = np.ones(len(rest))
    return Reference(rest, PIN_DIAMETER_PX * everywhere, 150.0 * everywhere, everywhere)


def pressed(random: np.random.Generator) -> Array:
    """Return the places (331, 2) of the pins in a dent of 0.3 to 1 spacing."""
    rest = _hexagon()
    at, way = random.uniform(150, 330, 2), random.normal(0, 1, 2)
    squared = ((rest - at) ** 2).sum(axis=1) / (4 * PIN_SPACING_PX) ** 2
    depth_px = random.uniform(0.3, 1.0) * PIN_SPACING_PX / np.linalg.norm(way)
    return np.asarray(rest + depth_px * np.exp(-0.5 * squared)[:, None] * way)


def _hexagon() -> Array:
    shells = range(-PIN_SHELLS, PIN_SHELLS + 1)
    pairs = [(q, r) for q in shells for r in shells if abs(q + r) <= PIN_SHELLS]
    return 240.0 + PIN_SPACING_PX * np.array([(q + 0.5 * r, np.sqrt(0.75) * r) for q, r in pairs])


def drawn(place_px: Array) -> Image:
    """Return a picture of dark pins at places (n, 2), with noise."""
    picture = np.full((480, 480), 190, np.uint8)
    for x, y in np.rint(16 * place_px).astype(int).tolist():
        cv2.circle(picture, (x, y), round(8 * PIN_DIAMETER_PX), 40, cv2.FILLED, cv2.LINE_AA, shift=4)
    noise = np.random.default_rng(1).normal(0, 2, picture.shape)
    return np.asarray(np.clip(cv2.GaussianBlur(picture, (5, 5), 1.0) + noise, 0, 255), np.uint8)


def _stills(folder: Path) -> Jpegs:
    dataset = read_dataset(folder)
    return tuple(np.fromfile(dataset.path(press), np.uint8) for press in dataset.split("test"))


def _files(folder: Path) -> Jpegs:
    return tuple(np.fromfile(path, np.uint8) for path in sorted(folder.glob("*.jpg")))


def _decode(jpeg: Image, *, grey: bool) -> Image:
    return np.asarray(cv2.imdecode(jpeg, cv2.IMREAD_GRAYSCALE if grey else cv2.IMREAD_COLOR), np.uint8)
