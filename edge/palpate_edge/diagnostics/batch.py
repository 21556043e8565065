"""Estimating a whole recording as fast as it can be read, for ``palpate-edge estimate``."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

from palpate_edge.calibration.recording_match import check_recording
from palpate_edge.common.contact import Contact
from palpate_edge.common.errors import DatasetError
from palpate_edge.datasets.pose_dataset import open_pose_recording
from palpate_edge.datasets.recording import Recording, all_frames, open_recording
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.estimation.estimator import Estimator
from palpate_edge.estimation.frame_estimator import FrameEstimator, Method
from palpate_edge.estimation.pose.pose_calibration import PoseCalibration
from palpate_edge.estimation.pose.pose_estimator import PoseEstimator

Progress = Callable[[int, int], None]  # done, total
Row = tuple[str, Contact, float]
"""Frame name, contact and milliseconds of estimation, without reading the file."""


def estimate_recording(
    path: Path,
    calibration: Calibration,
    calibration_path: Path,
    progress: Progress = lambda _done, _total: None,
    method: Method | None = None,
) -> Iterator[Row]:
    """Yield the row of every frame.

    Raises DatasetError for files that cannot be used or when every frame has another size than the
    calibration's, CalibrationError when the recording is of another sensor.
    """
    recording = open_recording(path, grey=calibration.appearance.channel == "grey")
    try:
        check_recording(calibration, calibration_path, recording.sensor, path)
        estimator, size_px = Estimator(calibration, method), calibration.sensor.image_size_px
        yield from _rows(recording, estimator, size_px, path, calibration_path, progress)
    finally:
        recording.close()


def estimate_poses(
    path: Path,
    calibration: PoseCalibration,
    calibration_path: Path,
    progress: Progress = lambda _done, _total: None,
) -> Iterator[Row]:
    """Yield the row of every frame of a pose dataset, a folder of images, an image or a video.

    Raises DatasetError as :func:`estimate_recording` does.
    """
    recording = open_pose_recording(path, grey=calibration.appearance.channel == "grey")
    try:
        estimator, size_px = PoseEstimator(calibration), calibration.sensor.image_size_px
        yield from _rows(recording, estimator, size_px, path, calibration_path, progress)
    finally:
        recording.close()


def _rows(
    recording: Recording,
    estimator: FrameEstimator,
    size_px: tuple[int, int],
    path: Path,
    calibration_path: Path,
    progress: Progress,
) -> Iterator[Row]:
    size_fits = False
    for frame in all_frames(recording):
        size = (frame.image.shape[1], frame.image.shape[0])
        size_fits |= size == size_px
        if frame.sequence == recording.count - 1 and not size_fits:
            raise DatasetError(
                f"{path}: frames are {size[0]}x{size[1]}, calibration {calibration_path} is for "
                f"{size_px[0]}x{size_px[1]}: record at that size or calibrate for this one"
            )
        begin = time.perf_counter()
        contact = estimator.estimate(frame)
        yield frame.name, contact, 1e3 * (time.perf_counter() - begin)
        progress(frame.sequence + 1, recording.count)
