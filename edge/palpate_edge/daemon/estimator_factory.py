"""The estimator of a configuration: by its calibration, or without one."""

from __future__ import annotations

from pathlib import Path

from palpate_edge.calibration.calibration_file import load_calibration
from palpate_edge.calibration.pose.pose_calibration_file import is_pose_calibration, load_pose_calibration
from palpate_edge.common.errors import CalibrationError
from palpate_edge.daemon.capture_factory import AnyCalibration
from palpate_edge.daemon.config import FingertipConfig
from palpate_edge.datasets.sensor_file import read_sensor
from palpate_edge.estimation.estimator import Estimator
from palpate_edge.estimation.frame_estimator import FrameEstimator, Method
from palpate_edge.estimation.pose.pose_calibration import PoseCalibration
from palpate_edge.estimation.pose.pose_estimator import PoseEstimator
from palpate_edge.estimation.uncalibrated import UncalibratedEstimator
from palpate_edge.geometry.sensor import bead_layout_mm


def configured_calibration(config: FingertipConfig) -> AnyCalibration | None:
    """Load the calibration, of contacts or of poses.

    None when none is named, or when its file is missing and not required. Raises CalibrationError for a file
    that is required and missing, or unusable.
    """
    name, path = config.estimator.calibration, Path(config.estimator.calibration)
    if not name or (not config.estimator.calibration_required and not path.exists()):
        return None
    return load_pose_calibration(path) if is_pose_calibration(path) else load_calibration(path)


def make_estimator(config: FingertipConfig, calibration: AnyCalibration | None) -> FrameEstimator:
    """Return the estimator by the configured method. Raises CalibrationError, DatasetError."""
    if calibration is None:
        described = config.estimator.sensor
        markers = bead_layout_mm(read_sensor(Path(described)).markers)[0] if described else ()
        return UncalibratedEstimator(len(markers))
    chosen = config.estimator.method
    if isinstance(calibration, PoseCalibration):
        if chosen != "best":
            raise CalibrationError(
                f"{config.estimator.calibration} calibrates pose labels, which have no method {chosen}: "
                "remove estimator.method"
            )
        return PoseEstimator(calibration)
    return Estimator(calibration, None if chosen == "best" else Method(chosen))
