"""Estimating a whole recording as fast as it can be read, for ``palpate-edge estimate``."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

from palpate_edge.calibration.recording_match import check_recording
from palpate_edge.common.contact import Contact
from palpate_edge.common.errors import DatasetError
from palpate_edge.datasets.recording import all_frames, open_recording
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.estimation.estimator import Estimator, Method


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
