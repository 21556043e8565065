"""Estimating a whole recording as fast as it can be read, for ``palpate-edge estimate``."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from palpate_edge.common.contact import Contact
from palpate_edge.common.errors import CalibrationError, DatasetError
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.press_dataset import is_dataset, read_dataset
from palpate_edge.datasets.recording import all_frames, open_recording
from palpate_edge.estimation.calibration_file import Calibration, check_sensor
from palpate_edge.estimation.estimator import Estimator, Method
from palpate_edge.geometry.sensor import Sensor
from palpate_edge.vision.blob_detection import plane
from palpate_edge.vision.tracker import Tracker

MAX_REFERENCE_SHIFT_PX = 1.5  # two sensors of one make differ by more, one sensor over its life by less


def estimate_recording(
    path: Path,
    calibration: Calibration,
    calibration_path: Path,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
    method: Method | None = None,
) -> Iterator[tuple[str, Contact, float]]:
    """Frame name, contact and milliseconds of estimation (without reading the file) of every frame.

    Raises DatasetError for files that cannot be used or when every frame has another size than the
    calibration's, CalibrationError when the recording is of another sensor.
    """
    recording = open_recording(path, grey=calibration.appearance.channel == "grey")
    try:
        check_recording(calibration, calibration_path, recording.sensor, path)
        estimator = Estimator(calibration, method)
        size_fits = False
        for frame in all_frames(recording):
            size = (frame.image.shape[1], frame.image.shape[0])
            size_fits |= size == calibration.sensor.image_size_px
            if frame.sequence == recording.count - 1 and not size_fits:
                expected = calibration.sensor.image_size_px
                raise DatasetError(
                    f"{path}: frames are {size[0]}x{size[1]}, calibration {calibration_path} is for "
                    f"{expected[0]}x{expected[1]}: record at that size or calibrate for this one"
                )
            begin = time.perf_counter()
            contact = estimator.estimate(frame)
            yield frame.name, contact, 1e3 * (time.perf_counter() - begin)
            progress(frame.sequence + 1, recording.count)
    finally:
        recording.close()


def check_recording(
    calibration: Calibration, calibration_path: Path, described: Sensor | None, path: Path
) -> None:
    """Refuse a recording of another sensor: by its description and its reference frames, where it has them.

    Raises CalibrationError.
    """
    if described is not None:
        check_sensor(calibration, calibration_path, described, path / "sensor.toml")
    if is_dataset(path):
        _check_reference(calibration, calibration_path, path)


def _check_reference(calibration: Calibration, calibration_path: Path, folder: Path) -> None:
    """A dataset's untouched frame must show the beads where the calibration has them."""
    dataset = read_dataset(folder)
    image = read_image(dataset.reference[0])
    if image.shape[1::-1] != calibration.sensor.image_size_px:
        return
    reference = calibration.reference()
    beads = Tracker(reference).follow(plane(image, calibration.appearance))
    shift_px = np.linalg.norm(beads.position_px - reference.position_px, axis=1)[beads.found]
    if not len(shift_px) or float(np.median(shift_px)) > MAX_REFERENCE_SHIFT_PX:
        moved = f"{float(np.median(shift_px)):.1f} px off" if len(shift_px) else "not there"
        raise CalibrationError(
            f"calibration {calibration_path} is of another sensor: its beads are {moved} in "
            f"{dataset.reference[0]}; run palpate-edge calibrate {folder}"
        )
