"""Where the tracker finds beads against where they really are, on the sample's sensor as the twin draws it.

The press sample does not tell its beads' true places. The twin renders sensors of the same sensor.toml, with
tolerances and looks of their own, and knows each bead's outline.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bench.accuracy_report import Section, number, paragraph, table
from bench.accuracy_stress import HARMS, Harm
from palpate_edge.calibration.measurement import measure as look
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
SHOWN = tuple(name for name in HARMS if not name.startswith("25 beads") or name.endswith("draw 1"))
CLEAN = SHOWN[0]
GOAL_PX, STRESS_GOAL_PX = 0.05, 0.1


def measure(sample: PressDataset, work: Path) -> dict[str, Array]:
    """Distances in px of all beads found from their true places, by harm."""
    parts: dict[str, list[Array]] = {name: [] for name in SHOWN}
    for seed in SEEDS:
        view = CameraView(with_tolerances(sample.sensor, seed), load_library())
        shots = single_presses(view, PLAN, seed)
        folder = work / f"beads-{seed}"
        write_dataset(folder, view, shots, PLAN.references, seed)
        dataset = read_dataset(folder)
        true_px = [view.outlines(view.dome.press(shot.press) if shot.press else None)[0] for shot in shots]
        for name in SHOWN:
            parts[name].append(_distances(dataset, view.outlines(None)[0], true_px, HARMS[name], seed))
    return {name: np.concatenate(found) for name, found in parts.items()}


def _distances(
    dataset: PressDataset, rest_px: Array, true_px: Sequence[Array], harm: Harm, seed: int
) -> Array:
    """Of one sensor's frames, each made worse and tracked from the untouched dome."""
    sight = look(dataset, ())
    reference, tracker, random = sight.reference, Tracker(sight.reference), np.random.default_rng(seed)
    bead_of = np.linalg.norm(reference.position_px[:, None] - rest_px[None], axis=2).argmin(axis=1)
    found = []
    for press, places in zip(dataset.presses, true_px, strict=True):
        shown = np.column_stack([places[bead_of], reference.diameter_px])
        image = harm(read_image(dataset.path(press)), shown, random)
        tracker.reset()
        beads = tracker.follow(plane(image, sight.registration.appearance))
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
        The press sample does not tell where its beads really are. These are {len(SEEDS)} sensors of the
        sample's sensor.toml as the twin renders them (tolerances, silicone and looks from the seeds
        {SEEDS[0]} to {SEEDS[-1]}: also coloured beads, glare, print), {PLAN.test} presses each: distance in
        px from each bead that was found to the middle of its outline as drawn. `make accuracy`.
        """)
    head = ("frames", "beads found", "median px", "p95", "p99", "goal, median")
    missed = tuple(
        f"Beads under {name}: median error {np.median(off_px):.3f} px, not {_goal_px(name):g}."
        for name, off_px in found.items()
        if np.median(off_px) > _goal_px(name)
    )
    return Section("\n\n".join(["## Beads", text, table(head, rows)]), missed)


def _goal_px(name: str) -> float:
    return GOAL_PX if name == CLEAN else STRESS_GOAL_PX
