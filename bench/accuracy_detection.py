"""The smallest force that is told from no touch: the contact threshold in newtons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.accuracy_report import Section, number, paragraph, table
from palpate_edge.common.arrays import Array
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.press_dataset import PressDataset
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.estimation.skin_motion import SkinMotion
from palpate_edge.vision.appearance import plane
from palpate_edge.vision.tracker import Tracker

LIGHT_N = 0.3  # presses below this are on the straight part of the curve


@dataclass(frozen=True, slots=True)
class Motions:
    """force_N (n,) and skin motion motion_px (n,) of the touches, rest_px (m,) of the frames without."""

    force_N: Array
    motion_px: Array
    rest_px: Array


def measure(datasets: Sequence[PressDataset], calibration: Calibration) -> Motions:
    """Skin motion of every frame of all datasets, as the estimator's contact test takes it."""
    reference = calibration.reference()
    skin = SkinMotion(reference)
    force, motion, rest = [], [], []
    for dataset in datasets:
        tracker = Tracker(reference)
        for press in dataset.presses:
            image = read_image(dataset.path(press))
            size_px = skin.measure(tracker.follow(plane(image, calibration.appearance))).size_px
            if press.position_mm is None:
                rest.append(size_px)
            else:
                force.append(press.normal_force_N)
                motion.append(size_px)
    return Motions(np.array(force), np.array(motion), np.array(rest))


def section(motions: Motions, calibration: Calibration) -> Section:
    """Force at the threshold by a line through the origin: skin motion is proportional to a light force."""
    light = (motions.force_N > 0) & (motions.force_N < LIGHT_N)
    slope_px_N = motions.motion_px[light] / motions.force_N[light]
    typical, stiff = np.median(slope_px_N), np.percentile(slope_px_N, 5)
    threshold_px, threshold_N = calibration.contact_threshold_px, calibration.contact_threshold_N
    below = motions.force_N < (threshold_N or 0.0)
    missed = motions.force_N[motions.motion_px <= threshold_px]
    detected = motions.force_N[motions.motion_px > threshold_px]
    false = int((motions.rest_px > threshold_px).sum())
    rows = [
        ("contact threshold, N, as the calibration has it", number(threshold_N, 4)),
        ("contact threshold, px of skin motion", f"{threshold_px:.3f}"),
        ("largest motion in a frame without touch, px", f"{motions.rest_px.max():.3f}"),
        ("skin motion, px/N: median over light presses", f"{typical:.2f}"),
        ("skin motion, px/N: where the dome is stiffest (5th percentile)", f"{stiff:.2f}"),
        ("force at the threshold, N: median", f"{threshold_px / typical:.4f}"),
        ("force at the threshold, N: where the dome is stiffest", f"{threshold_px / stiff:.4f}"),
        ("lightest touch seen, N", f"{detected.min():.4f}"),
        ("heaviest touch missed, N", f"{missed.max():.4f}" if len(missed) else "none"),
        ("touches of the threshold or more missed", _share(motions.motion_px[~below] <= threshold_px)),
        ("lighter touches missed", _share(motions.motion_px[below] <= threshold_px)),
        ("false touches", f"{false} of {len(motions.rest_px)}"),
    ]
    text = paragraph(f"""
        From all frames of the sample (train and test) and of the sequences; the line is fitted to
        the {int(light.sum())} touches below {LIGHT_N:g} N. The threshold is what `palpate-edge
        calibrate` prints as "contact above", in newtons from the lightest third of its presses,
        where the dome is stiffest; this table's command is `make accuracy`.
        """)
    note = f"Touches lighter than about {threshold_N or 0.0:.3f} N may be missed; {len(missed)} were."
    return Section("\n\n".join(["## The smallest force", text, table(("", "figure"), rows)]), (note,))


def _share(which: NDArray[np.bool_]) -> str:
    return f"{int(which.sum())} of {len(which)}"
