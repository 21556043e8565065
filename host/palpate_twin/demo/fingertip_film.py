"""Pictures and published contacts of one fingertip during a demo run, side by side."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from palpate_bus.logs.candump import read_log
from palpate_edge.calibration.calibration_file import load_calibration
from palpate_edge.common.arrays import Image
from palpate_edge.common.errors import DatasetError
from palpate_edge.datasets.images import read_image
from palpate_edge.vision.tracker import Tracker
from palpate_host.common.tip_contact import TipContact
from palpate_twin.camera.kept_pictures import kept_pictures
from palpate_twin.demo.fingertip_panels import bead_panel, dome_panel
from palpate_twin.demo.run_folder import RunFolder
from palpate_twin.demo.truth import read_pairs, truth_of_twin


@dataclass(frozen=True, slots=True)
class Sight:
    """One kept picture and the contact that the fingertip published for it."""

    picture: Path
    contact: TipContact


def read_sights(folder: RunFolder, finger: str) -> list[Sight]:
    """Return the kept pictures of a finger with their contacts, in the order of time.

    Raises DatasetError if there are none, ConfigError or LogError for an unusable run folder.
    """
    (config,) = (each for each in folder.fingertips() if each.name == finger)
    pictures = kept_pictures(folder.pictures(finger))
    truth = truth_of_twin(folder.truth / f"{finger}.csv")
    pairs, _ = read_pairs(read_log(folder.log).records, config.node.id, truth)
    sights = [Sight(pictures[pair.sequence], pair.contact) for pair in pairs if pair.sequence in pictures]
    if not sights:
        raise DatasetError(
            f"{folder.pictures(finger)}: no picture of a published contact: run the demo again"
        )
    return sights


def busiest_finger(folder: RunFolder, names: Sequence[str]) -> str:
    """Return the finger whose published contact spread the most over its dome. Raises the errors of
    :func:`read_sights`."""

    def spread_mm(finger: str) -> float:
        touched = [sight.contact for sight in read_sights(folder, finger)]
        places = [
            contact.position_mm
            for contact in touched
            if contact.valid and contact.in_contact and contact.position_mm is not None
        ]
        return float(np.std(places, axis=0).sum()) if places else -1.0

    return max(names, key=spread_mm)


def draw_sights(folder: RunFolder, finger: str, stamps_us: Sequence[float], height: int) -> list[Image]:
    """Return for each time (Unix time, us) the camera's image with beads beside the dome with the contact.

    Each picture is the latest one exposed by then. Raises the errors of :func:`read_sights`.
    """
    sights = read_sights(folder, finger)
    (config,) = (each for each in folder.fingertips() if each.name == finger)
    calibration = load_calibration(Path(config.estimator.calibration))
    reference = calibration.reference()
    tracker = Tracker(reference)
    radius_mm = calibration.sensor.dome.outer_radius_mm
    exposed_us = [sight.contact.exposed_at_us for sight in sights]
    drawn: dict[int, Image] = {}
    indices = [max(0, bisect_right(exposed_us, stamp_us) - 1) for stamp_us in stamps_us]
    for index in sorted(set(indices)):
        image = read_image(sights[index].picture)
        beads = tracker.follow_image(image, calibration.appearance)
        beside = (
            bead_panel(image, reference, beads, height),
            dome_panel(sights[index].contact, radius_mm, height),
        )
        drawn[index] = np.hstack(beside)
    return [drawn[index] for index in indices]


def draw_fingertips(folder: RunFolder, names: Sequence[str], stamp_us: float, height: int) -> Image:
    """Return the pictures of all fingertips at one time (Unix time, us), one below the other.

    Raises the errors of :func:`read_sights`.
    """
    rows = []
    for name in names:
        (row,) = draw_sights(folder, name, [stamp_us], height)
        cv2.putText(
            row, name, (10, height - 14), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (255, 255, 255), 1, cv2.LINE_AA
        )
        rows.append(row)
    return np.vstack(rows)
