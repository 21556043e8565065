"""Smallest detectable force: the contact threshold in newtons."""

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

LIGHT_N = 0.3  # below this force, skin motion is proportional to the force


@dataclass(frozen=True, slots=True)
class Motions:
    """Skin motions. force_N (n,), motion_px (n,): frames with contact; no_contact_px (m,): frames without."""

    force_N: Array
    motion_px: Array
    no_contact_px: Array


def measure(datasets: Sequence[PressDataset], calibration: Calibration) -> Motions:
    """Return the skin motion of every frame of all datasets, as used by the estimator's contact test."""
    reference = calibration.reference()
    skin = SkinMotion(reference)
    force, motion, no_contact = [], [], []
    for dataset in datasets:
        tracker = Tracker(reference)
        for press in dataset.presses:
            image = read_image(dataset.path(press))
            size_px = skin.measure(tracker.follow(plane(image, calibration.appearance))).size_px
            if press.position_mm is None:
                no_contact.append(size_px)
            else:
                force.append(press.normal_force_N)
                motion.append(size_px)
    return Motions(np.array(force), np.array(motion), np.array(no_contact))


def section(motions: Motions, calibration: Calibration) -> Section:
    """Return the section; the force at the threshold follows from a line through the origin."""
    light = (motions.force_N > 0) & (motions.force_N < LIGHT_N)
    slope_px_N = motions.motion_px[light] / motions.force_N[light]
    typical, stiff = np.median(slope_px_N), np.percentile(slope_px_N, 5)
    threshold_px, threshold_N = calibration.contact_threshold_px, calibration.contact_threshold_N
    below = motions.force_N < (threshold_N or 0.0)
    missed = motions.force_N[motions.motion_px <= threshold_px]
    detected = motions.force_N[motions.motion_px > threshold_px]
    false = int((motions.no_contact_px > threshold_px).sum())
    rows = [
        ("contact threshold in the calibration, N", number(threshold_N, 4)),
        ("contact threshold, px of skin motion", f"{threshold_px:.3f}"),
        ("largest motion in a frame without contact, px", f"{motions.no_contact_px.max():.3f}"),
        ("skin motion, px/N: median of light presses", f"{typical:.2f}"),
        ("skin motion, px/N: where the dome is stiffest (5th percentile)", f"{stiff:.2f}"),
        ("force at the threshold, N: median", f"{threshold_px / typical:.4f}"),
        ("force at the threshold, N: where the dome is stiffest", f"{threshold_px / stiff:.4f}"),
        ("smallest detected force, N", f"{detected.min():.4f}"),
        ("largest missed force, N", f"{missed.max():.4f}" if len(missed) else "none"),
        ("missed contacts at or above the threshold", _share(motions.motion_px[~below] <= threshold_px)),
        ("missed contacts below the threshold", _share(motions.motion_px[below] <= threshold_px)),
        ("false contacts", f"{false} of {len(motions.no_contact_px)}"),
    ]
    text = paragraph(f"""
        All frames of the sample (train and test) and of the sequences are used; the line is fitted
        to the {int(light.sum())} contacts below {LIGHT_N:g} N. `palpate-edge calibrate` prints the
        threshold as "contact above". Its value in newtons is computed from the lightest third of the
        presses, at the stiffest places of the dome. Command: `make accuracy`.
        """)
    note = f"Contacts below about {threshold_N or 0.0:.3f} N may be missed; {len(missed)} were missed here."
    return Section("\n\n".join(["## The smallest force", text, table(("", "figure"), rows)]), (note,))


def _share(which: NDArray[np.bool_]) -> str:
    return f"{int(which.sum())} of {len(which)}"
