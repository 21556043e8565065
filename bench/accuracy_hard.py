"""Errors on the hard sensor (cyan beads, changing room light): press-hard and press-hard-sequence."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.accuracy_report import Section, number, paragraph, rejected, table, wrong_flags
from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.evaluation import Figures, evaluate_dataset
from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.common.arrays import Array, Image
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.press_dataset import PressDataset, read_dataset
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.vision.tracker import Tracker

PRESSES, SEQUENCE = "press-hard", "press-hard-sequence"
WHITE = 254  # least grey level, in all channels, of bead and skin that show no difference
AROUND = 0.7  # half the side of the square that shows a bead, in bead diameters
DARKEST_PERCENT = 2  # of that square's pixels; noise and specks


@dataclass(frozen=True, slots=True)
class HardFigures:
    """Figures of the hard sensor.

    dropped: train presses left out by the calibration; visible, found: beads that are not hidden in the test
    presses, and beads that were tracked there; invented: tracked beads beyond those that are not hidden;
    white: least number of beads that are not hidden, but lie in light that clips bead and skin to white.
    """

    presses: Figures
    sequence: Figures
    calibration: Calibration
    train: int
    visible: int
    found: int
    invented: int
    white: int


def measure(data: Path) -> HardFigures:
    """Calibrate with all train presses of the hard sensor; evaluate its test presses and its sequence."""
    dataset = read_dataset(data / PRESSES)
    calibration = calibrate(dataset, dome=load_dome_model())
    figures, sequence = (
        evaluate_dataset(data / name, "test", calibration, data / name, None) for name in (PRESSES, SEQUENCE)
    )
    train = sum(press.position_mm is not None for press in dataset.split("train"))
    return HardFigures(figures, sequence, calibration, train, *_beads(dataset, calibration))


def _beads(dataset: PressDataset, calibration: Calibration) -> tuple[int, int, int, int]:
    """Return the numbers of visible, of found, of invented and of white beads over the test presses."""
    reference = calibration.reference()
    tracker = Tracker(reference)
    visible = found = invented = white = 0
    for press in dataset.split("test"):
        tracker.reset()
        image = read_image(dataset.path(press))
        beads = tracker.follow_image(image, calibration.appearance)
        there = len(beads.found) - press.lost
        visible += there
        found += min(beads.found_count, there)
        invented += max(0, beads.found_count - there)
        lost = zip(beads.position_px[beads.lost], reference.diameter_px[beads.lost], strict=True)
        # The hidden ones may all be among the white ones.
        white += max(0, sum(_is_white(image, *bead) for bead in lost) - press.lost)
    return visible, found, invented, white


def _is_white(image: Image, place_px: Array, diameter_px: float) -> bool:
    """Return whether the image about a bead is clipped in all channels."""
    reach = round(AROUND * diameter_px)
    x, y = np.rint(place_px).astype(int)
    around = image[max(y - reach, 0) : max(y + reach + 1, 0), max(x - reach, 0) : max(x + reach + 1, 0)]
    return bool(around.size and np.percentile(around, DARKEST_PERCENT, axis=(0, 1)).min() >= WHITE)


def section(figures: HardFigures) -> Section:
    """Return the goals of the hard sensor beside its figures."""
    presses, sequence = figures.presses, figures.sequence
    used = figures.calibration.source.presses
    flags = 100 * wrong_flags(presses) / max(presses.confusion.judged, 1)
    seen = 100 * figures.found / figures.visible
    goals: list[tuple[str, float | None, float, bool]] = [
        ("beads that are not hidden found, %", seen, 97.0, True),
        ("beads found beyond those that are not hidden", figures.invented, 0, False),
        ("position, mean, mm", presses.overall.mean_mm, 0.5, False),
        ("force RMSE, % of the largest", presses.overall.force_rmse_percent, 3.0, False),
        ("frames rejected, %", 100 * rejected(presses) / presses.frames, 2.0, False),
        ("contact threshold, N", presses.confusion.threshold_N, 0.15, False),
        ("wrong contact flags above the threshold, %", flags, 2.0, False),
        ("sequence: position, mean, mm", sequence.overall.mean_mm, 0.35, False),
    ]
    rows, missed = [], []
    for name, value, goal, at_least in goals:
        met = value is not None and (value >= goal if at_least else value <= goal)
        sign = ">=" if at_least else "<="
        rows.append((name, f"{sign} {goal:g}", number(value), "yes" if met else "no"))
        if not met:
            missed.append(f"Hard sensor, goal not met: {name}: {number(value)}, goal {sign} {goal:g}.")
    text = paragraph(f"""
        A specimen with cyan beads in another layout under strong changing room light: flicker, blur, noise,
        JPEG 60, specks, reflections of the LEDs and up to 12 hidden beads in a frame. {used} of
        {figures.train} train presses were used, {presses.frames} test frames and {sequence.frames} frames of
        the sequence evaluated; {rejected(presses)} and {rejected(sequence)} were rejected. Commands:
        `palpate-edge calibrate {PRESSES} -o hard.cal`, `palpate-edge evaluate {PRESSES} --calibration
        hard.cal`.
        """)
    limit = paragraph(f"""
        {figures.white} or more of the {figures.visible} beads that are not hidden lie where light clips
        bead and skin alike to white: around the predicted place {100 - DARKEST_PERCENT} % of the pixels
        have {WHITE} or more in every channel. Without them
        {100 * (1 - figures.white / figures.visible):.1f} % are left to find.
        """)
    note = paragraph("""
        The images come from the same finite-element model as those of the press sample. Force has never
        been measured on pictures of a real dome: no public set of a marker dome has newtons.
        """)
    head = ("", "goal", "figure", "met")
    return Section("\n\n".join(["## Hard light", text, table(head, rows), limit, note]), tuple(missed))
