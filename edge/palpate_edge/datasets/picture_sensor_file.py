"""Read and check the sensor.toml of a sensor without a drawing (docs/own-sensor.md)."""

from __future__ import annotations

from pathlib import Path

import msgspec

from palpate_edge.common.config_file import read_toml
from palpate_edge.common.errors import DatasetError
from palpate_edge.datasets.sensor_file import picture_checks, refuse_out_of_range
from palpate_edge.geometry.picture_sensor import PictureSensor, hexagonal_counts

GUIDE = "docs/own-sensor.md"
MARKER_COUNTS = range(7, 2001)


def read_picture_sensor(path: Path) -> PictureSensor:
    """Read a ``sensor.toml`` without a drawing. Raises DatasetError with the key and what is allowed."""
    guide = f"{GUIDE} lists the keys of a sensor without drawing"
    sensor = read_toml(path, PictureSensor, guide=guide, error=DatasetError, trusted=False)
    camera, markers = sensor.camera, sensor.markers
    size, count = markers.diameter_px, markers.count
    checks = [
        *picture_checks(camera.width, camera.height, camera.fps),
        ("markers.diameter_px", size, size is None or 3 <= size <= 200, "3 to 200, or left out"),
        ("markers.count", count, count is None or count in MARKER_COUNTS, "7 to 2000, or left out"),
    ]
    if sensor.labels is not msgspec.UNSET:
        turn = sensor.labels.x_axis_deg
        checks.append(("labels.x_axis_deg", turn, -360 <= turn <= 360, "-360 to 360"))
    if markers.layout == "hexagonal":
        fitting = [number for number in hexagonal_counts(max(MARKER_COUNTS)) if number in MARKER_COUNTS]
        allowed = f"one of {', '.join(map(str, fitting[:12]))}, ... for a hexagonal layout"
        if count is None:
            raise DatasetError(f"{path}: markers.count is missing: it must be {allowed}")
        checks.append(("markers.count", count, count in fitting, allowed))
    refuse_out_of_range(path, checks)
    return sensor
