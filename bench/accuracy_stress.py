"""Errors on degraded frames of the test split: JPEG, flicker, blur, noise, hidden beads, glare."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.accuracy_report import Section, number, paragraph, rejected, table, wrong_flags
from palpate_edge.calibration.evaluation import Figures, evaluate_dataset
from palpate_edge.common.arrays import Array, Image
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.press_dataset import PressDataset
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.vision.appearance import plane
from palpate_edge.vision.tracker import Tracker

Random = np.random.Generator
Degradation = Callable[[Image, Array, Random], Image]  # image, beads (n, 3) with position and diameter in px

PAINTED = 0.75  # radius of the disc painted over a bead, in bead diameters
GLARE_PX = 60
LEAST_COVERED_PERCENT = 90.0
COMMAND = "`palpate-edge evaluate STRESSED --calibration sample.cal`"


def jpeg60(image: Image, _beads: Array, _random: Random) -> Image:
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 60])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)


def flicker(image: Image, _beads: Array, random: Random) -> Image:
    """Change the brightness by a random factor of up to 15 %."""
    return _to_image(image * random.uniform(0.85, 1.15))


def blur(image: Image, _beads: Array, _random: Random) -> Image:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 1.5), np.uint8)


def noise(image: Image, _beads: Array, random: Random) -> Image:
    return _to_image(image + 8.0 * random.standard_normal(image.shape))


def hide(count: int) -> Degradation:
    """Return a degradation that paints `count` random beads over with the colour of the skin around them."""

    def painted(image: Image, beads: Array, random: Random) -> Image:
        image = image.copy()
        for x, y, diameter in beads[random.permutation(len(beads))[:count]]:
            centre, radius = (round(x), round(y)), round(PAINTED * diameter)
            ring = np.zeros(image.shape[:2], np.uint8)
            cv2.circle(ring, centre, radius + 2, 255, 2)
            skin = tuple(np.median(image[ring > 0], axis=0).tolist())
            cv2.circle(image, centre, radius, skin, cv2.FILLED)
        return image

    return painted


def glare(image: Image, beads: Array, random: Random) -> Image:
    """Add a white spot near a random bead, saturated in the middle, with a half-width of `GLARE_PX`."""
    x, y = beads[random.integers(len(beads)), :2] + random.uniform(-10, 10, 2)
    rows, columns = np.mgrid[0 : image.shape[0], 0 : image.shape[1]]
    squared = (columns - x) ** 2 + (rows - y) ** 2
    blob = np.clip(1.5 * np.exp(-np.log(3.0) * squared / (GLARE_PX / 2) ** 2), 0, 1)
    return _to_image(image + (255.0 - image) * blob[..., None])


def all_together(image: Image, beads: Array, random: Random) -> Image:
    """Apply flicker, hide up to 12 beads, and compress with JPEG 60."""
    hidden = hide(int(random.integers(13)))(image, beads, random)
    return jpeg60(flicker(hidden, beads, random), beads, random)


TOGETHER = "flicker, 0 to 12 beads hidden and JPEG 60"
DEGRADATIONS: dict[str, Degradation] = {
    "as recorded": lambda image, _beads, _random: image,
    "JPEG 60": jpeg60,
    "brightness flicker of 15 %": flicker,
    "Gaussian blur, sigma 1.5 px": blur,
    "noise, sigma 8 grey levels": noise,
    "5 beads painted over": hide(5),
    "12 beads painted over": hide(12),
    **{f"25 beads painted over, draw {draw}": hide(25) for draw in range(1, 11)},
    f"a glare patch of {GLARE_PX} px": glare,
    TOGETHER: all_together,
}


def measure(
    dataset: PressDataset, calibration: Calibration, work: Path, report_progress: Callable[[str], None]
) -> dict[str, Figures]:
    """Return the figures of each degradation by name."""
    clean = [read_image(dataset.path(press)) for press in dataset.split("test")]
    beads = _beads(clean, calibration)
    found = {}
    for number_, (name, degrade) in enumerate(DEGRADATIONS.items()):
        report_progress(name)
        random = np.random.default_rng(number_)
        images = [degrade(image, places, random) for image, places in zip(clean, beads, strict=True)]
        folder = _write(dataset, images, work / str(number_))
        found[name] = evaluate_dataset(folder, "test", calibration, folder, None)
    return found


def section(found: dict[str, Figures]) -> Section:
    rows = []
    for name, figures in found.items():
        overall = figures.overall
        cells = (overall.mean_mm, overall.p95_mm, overall.force_rmse_percent, overall.covered_percent)
        rows.append(
            (name, *(number(cell) for cell in cells), str(rejected(figures)), str(wrong_flags(figures)))
        )
    head = ("frames", "mean mm", "p95 mm", "force %", "covered %", "rejected", "wrong contact flags")
    frames = next(iter(found.values())).frames
    text = paragraph(f"""
        The {frames} test frames of the press sample, degraded; the calibration uses clean frames.
        "rejected" and "wrong contact flags" are numbers of frames. Rejected frames are excluded from all
        other columns, contacts below the contact threshold from the wrong flags. Command: {COMMAND},
        where STRESSED is the dataset with the degraded frames.
        """)
    return Section("\n\n".join(["## Stress", text, table(head, rows)]), _shortcomings(found))


def _shortcomings(found: dict[str, Figures]) -> tuple[str, ...]:
    clean_mm = next(iter(found.values())).overall.mean_mm or np.inf
    sentences = []
    for name, figures in found.items():
        faults = []
        growth = (figures.overall.mean_mm or 0.0) / clean_mm
        if growth > 2:
            faults.append(f"the mean error is {growth:.1f} times as large")
        if rejected(figures):
            faults.append(f"{rejected(figures)} of {figures.frames} frames are rejected")
        if wrong_flags(figures):
            faults.append(f"the contact flag is wrong in {wrong_flags(figures)} frames")
        covered = figures.overall.covered_percent
        if covered is not None and covered < LEAST_COVERED_PERCENT:
            faults.append(f"the 95 % radius contains only {covered:.0f} % of the contacts")
        if faults:
            sentences.append(f"With {name}: {', '.join(faults)}.")
    return tuple(sentences)


def _beads(images: Sequence[Image], calibration: Calibration) -> list[Array]:
    """Return position and diameter (n, 3) of every bead in each image."""
    reference = calibration.reference()
    tracker = Tracker(reference)
    places = [tracker.follow(plane(image, calibration.appearance)).position_px for image in images]
    return [np.column_stack([place, reference.diameter_px]) for place in places]


def _write(dataset: PressDataset, images: Sequence[Image], folder: Path) -> Path:
    """Write a dataset of the test split with other images, stored without loss."""
    (folder / "frames").mkdir(parents=True)
    shutil.copy(dataset.folder / "sensor.toml", folder)
    shutil.copytree(dataset.folder / "reference", folder / "reference")
    presses = dataset.split("test")
    for press, image in zip(presses, images, strict=True):
        cv2.imwrite(str(folder / "frames" / Path(press.frame).with_suffix(".png")), image)
    header, *rows = (dataset.folder / "truth.csv").read_text(encoding="utf-8").splitlines()
    stored = {press.frame: str(Path(press.frame).with_suffix(".png")) for press in presses}
    named = ((row, row.partition(",")[0]) for row in rows)
    kept = [row.replace(name, stored[name], 1) for row, name in named if name in stored]
    (folder / "truth.csv").write_text("\n".join([header, *kept]) + "\n", encoding="utf-8")
    return folder


def _to_image(values: NDArray[np.floating]) -> Image:
    return np.asarray(np.clip(np.round(values), 0, 255), np.uint8)
