"""Errors on the hard sensor (cyan beads, changing room light): press-hard and press-hard-sequence."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from bench.accuracy_report import Section, number, paragraph, rejected, table, wrong_flags
from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.evaluation import Figures, evaluate_dataset
from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.press_dataset import PressDataset, read_dataset
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.vision.tracker import Tracker

PRESSES, SEQUENCE = "press-hard", "press-hard-sequence"


@dataclass(frozen=True, slots=True)
class HardFigures:
    """Figures of the hard sensor.

    dropped: train presses left out by the calibration; visible, found: beads that are not hidden in the test
    presses, and beads that were tracked there; invented: tracked beads beyond those that are not hidden.
    """

    presses: Figures
    sequence: Figures
    calibration: Calibration
    train: int
    visible: int
    found: int
    invented: int


def measure(data: Path) -> HardFigures:
    """Calibrate with all train presses of the hard sensor; evaluate its test presses and its sequence."""
    dataset = read_dataset(data / PRESSES)
    calibration = calibrate(dataset, dome=load_dome_model())
    figures, sequence = (
        evaluate_dataset(data / name, "test", calibration, data / name, None) for name in (PRESSES, SEQUENCE)
    )
    train = sum(press.position_mm is not None for press in dataset.split("train"))
    return HardFigures(figures, sequence, calibration, train, *_beads(dataset, calibration))


def _beads(dataset: PressDataset, calibration: Calibration) -> tuple[int, int, int]:
    """Return the numbers of visible, of found and of invented beads over the test presses, frame by frame."""
    tracker = Tracker(calibration.reference())
    visible = found = invented = 0
    for press in dataset.split("test"):
        tracker.reset()
        image = read_image(dataset.path(press))
        beads = tracker.follow_image(image, calibration.appearance)
        there = len(beads.found) - press.lost
        visible += there
        found += min(beads.found_count, there)
        invented += max(0, beads.found_count - there)
    return visible, found, invented


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
    note = paragraph("""
        The images come from the same finite-element model as those of the press sample. Force has never
        been measured on pictures of a real dome: no public set of a marker dome has newtons.
        """)
    head = ("", "goal", "figure", "met")
    return Section("\n\n".join(["## Hard light", text, table(head, rows), note]), tuple(missed))
