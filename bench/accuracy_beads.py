"""Errors of the tracker's bead positions on rendered frames of the press sample's sensor.

The press sample does not contain the true bead positions. The twin renders sensors of the same sensor.toml,
with different tolerances and appearance, and provides each bead's outline.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bench.accuracy_report import Section, number, paragraph, table
from bench.accuracy_stress import DEGRADATIONS, Degradation
from palpate_edge.calibration.measurement import measure as measure_dataset
from palpate_edge.common.arrays import Array
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.press_dataset import PressDataset, read_dataset
from palpate_edge.vision.appearance import plane
from palpate_edge.vision.tracker import Tracker
from palpate_twin.camera.random_sensor import with_tolerances
from palpate_twin.camera.renderer import CameraView
from palpate_twin.camera.write_dataset import Plan, single_presses, write_dataset
from palpate_twin.dome.library import load_library

SEEDS = (200, 201, 202, 203)
PLAN = Plan(train=0, test=30)
SHOWN = tuple(name for name in DEGRADATIONS if not name.startswith("25 beads") or name.endswith("draw 1"))
CLEAN = SHOWN[0]
GOAL_PX, STRESS_GOAL_PX = 0.05, 0.1


def measure(sample: PressDataset, work: Path) -> dict[str, Array]:
    """Return the distances in px of all found beads from their true positions, by degradation."""
    parts: dict[str, list[Array]] = {name: [] for name in SHOWN}
    for seed in SEEDS:
        view = CameraView(with_tolerances(sample.sensor, seed), load_library())
        shots = single_presses(view, PLAN, seed)
        folder = work / f"beads-{seed}"
        write_dataset(folder, view, shots, PLAN.references, seed)
        dataset = read_dataset(folder)
        true_px = [view.outlines(view.dome.press(shot.press) if shot.press else None)[0] for shot in shots]
        for name in SHOWN:
            parts[name].append(_distances(dataset, view.outlines(None)[0], true_px, DEGRADATIONS[name], seed))
    return {name: np.concatenate(found) for name, found in parts.items()}


def _distances(
    dataset: PressDataset, reference_px: Array, true_px: Sequence[Array], degrade: Degradation, seed: int
) -> Array:
    """Return the errors of one sensor's frames, each degraded and tracked from the untouched dome."""
    measured = measure_dataset(dataset, ())
    reference, tracker, random = measured.reference, Tracker(measured.reference), np.random.default_rng(seed)
    bead_of = np.linalg.norm(reference.position_px[:, None] - reference_px[None], axis=2).argmin(axis=1)
    found = []
    for press, places in zip(dataset.presses, true_px, strict=True):
        shown = np.column_stack([places[bead_of], reference.diameter_px])
        image = degrade(read_image(dataset.path(press)), shown, random)
        tracker.reset()
        beads = tracker.follow(plane(image, measured.registration.appearance))
        found.append(np.linalg.norm(beads.position_px - places[bead_of], axis=1)[beads.found])
    return np.concatenate(found)


def section(found: dict[str, Array]) -> Section:
    rows = [
        (
            name,
            str(len(off_px)),
            *(number(float(np.percentile(off_px, share)), 3) for share in (50, 95, 99)),
            f"{_goal_px(name):g}",
        )
        for name, off_px in found.items()
    ]
    text = paragraph(f"""
        The press sample does not contain the true bead positions. The twin therefore renders
        {len(SEEDS)} sensors with the sample's sensor.toml and tolerances, silicone and appearance from
        the seeds {SEEDS[0]} to {SEEDS[-1]} (among them coloured beads, glare and print), with {PLAN.test}
        presses each. The error is the distance of a found bead from the centre of its rendered outline,
        in px. Command: `make accuracy`.
        """)
    head = ("frames", "beads found", "median px", "p95", "p99", "goal, median")
    missed = tuple(
        f"Beads with {name}: median error {np.median(off_px):.3f} px, goal {_goal_px(name):g} px."
        for name, off_px in found.items()
        if np.median(off_px) > _goal_px(name)
    )
    return Section("\n\n".join(["## Beads", text, table(head, rows)]), missed)


def _goal_px(name: str) -> float:
    return GOAL_PX if name == CLEAN else STRESS_GOAL_PX
