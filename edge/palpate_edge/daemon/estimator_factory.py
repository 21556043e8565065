"""The estimator of a configuration: by its calibration, or without one."""

from __future__ import annotations

from pathlib import Path

from palpate_edge.calibration.calibration_file import load_calibration
from palpate_edge.daemon.capture_factory import described_sensor
from palpate_edge.daemon.config import FingertipConfig
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.estimation.estimator import Estimator, Method
from palpate_edge.estimation.uncalibrated import ContactEstimator, UncalibratedEstimator
from palpate_edge.geometry.sensor import bead_layout_mm


def configured_calibration(config: FingertipConfig) -> Calibration | None:
    """Load the calibration; None when none is named, or when its file is missing and not required.

    Raises CalibrationError for a file that is required and missing, or unusable.
    """
    name, path = config.estimator.calibration, Path(config.estimator.calibration)
    if not name or (not config.estimator.calibration_required and not path.exists()):
        return None
    return load_calibration(path)


def make_estimator(config: FingertipConfig, calibration: Calibration | None) -> ContactEstimator:
    """Return the estimator by the configured method. Raises CalibrationError, DatasetError."""
    if calibration is None:
        sensor = described_sensor(config, None)
        return UncalibratedEstimator(0 if sensor is None else len(bead_layout_mm(sensor.markers)[0]))
    chosen = config.estimator.method
    return Estimator(calibration, None if chosen == "best" else Method(chosen))
