"""Check whether a recording comes from the sensor of a calibration."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from palpate_edge.calibration.calibration_file import check_sensor
from palpate_edge.common.errors import CalibrationError
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.press_dataset import is_dataset, read_dataset
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.geometry.sensor import Sensor
from palpate_edge.vision.tracker import Tracker

MAX_REFERENCE_SHIFT_PX = 1.5  # two sensors of one make differ by more, one sensor over its life by less


def check_recording(
    calibration: Calibration, calibration_path: Path, described: Sensor | None, path: Path
) -> None:
    """Refuse a recording of another sensor: by its description and its reference frames, where it has them.

    Raises CalibrationError.
    """
    if described is not None:
        check_sensor(calibration.sensor, calibration_path, described, path / "sensor.toml")
    if is_dataset(path):
        _check_reference(calibration, calibration_path, path)


def _check_reference(calibration: Calibration, calibration_path: Path, folder: Path) -> None:
    """A dataset's untouched frame must show the beads where the calibration has them."""
    dataset = read_dataset(folder)
    image = read_image(dataset.reference[0])
    if image.shape[1::-1] != calibration.sensor.image_size_px:
        return
    reference = calibration.reference()
    beads = Tracker(reference).follow_image(image, calibration.appearance)
    shift_px = np.linalg.norm(beads.position_px - reference.position_px, axis=1)[beads.found]
    if not len(shift_px) or float(np.median(shift_px)) > MAX_REFERENCE_SHIFT_PX:
        moved = f"{float(np.median(shift_px)):.1f} px off" if len(shift_px) else "not there"
        raise CalibrationError(
            f"calibration {calibration_path} is of another sensor: its beads are {moved} in "
            f"{dataset.reference[0]}; run palpate-edge calibrate {folder}"
        )
