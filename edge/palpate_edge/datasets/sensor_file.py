"""Read and check sensor.toml, the description of a sensor."""

from __future__ import annotations

import math
from pathlib import Path

import msgspec

from palpate_edge.common.errors import DatasetError
from palpate_edge.geometry.sensor import Sensor


def read_sensor(path: Path) -> Sensor:
    """Read a ``sensor.toml``. Raises DatasetError, naming file and key."""
    try:
        sensor = msgspec.toml.decode(path.read_bytes(), type=Sensor)
    except FileNotFoundError:
        raise DatasetError(f"{path} is missing: a press dataset describes its sensor there") from None
    except OSError as error:
        raise DatasetError(f"{path} cannot be read: {error.strerror}") from None
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        raise DatasetError(f"{path}: {error}: correct it as in docs/press-dataset.md") from None
    _check(sensor, path)
    return sensor


def _check(sensor: Sensor, path: Path) -> None:
    """Refuse what TOML's types cannot: sizes that no dome has."""
    checks = {
        "dome.outer_radius_mm": 0 < sensor.dome.outer_radius_mm < math.inf,
        "dome.wall_mm": 0 < sensor.dome.wall_mm < sensor.dome.outer_radius_mm,
        "markers.radius_mm": 0 < sensor.markers.radius_mm <= sensor.dome.outer_radius_mm,
        "markers.diameter_mm": 0 < sensor.markers.diameter_mm < sensor.markers.radius_mm,
        "markers.rings": all(
            0 < ring.count <= 1000 and 0 <= ring.theta_deg <= 180 and math.isfinite(ring.phi0_deg)
            for ring in sensor.markers.rings
        ),
        "camera.width": 16 <= sensor.camera.width <= 8192,
        "camera.height": 16 <= sensor.camera.height <= 8192,
        "camera.matrix": min(sensor.camera.matrix[:2]) > 0 and _all_finite(sensor.camera.matrix),
        "camera.distortion": len(sensor.camera.distortion) in ({4} if _is_fisheye(sensor) else {4, 5, 8})
        and _all_finite(sensor.camera.distortion),
        "camera.position_mm": _all_finite(sensor.camera.position_mm),
        "camera.fps": 0 < sensor.camera.fps <= 1000,
    }
    for key, holds in checks.items():
        if not holds:
            raise DatasetError(f"{path}: {key} is out of range: correct it as in docs/press-dataset.md")


def _all_finite(values: tuple[float, ...]) -> bool:
    return all(math.isfinite(value) for value in values)


def _is_fisheye(sensor: Sensor) -> bool:
    return sensor.camera.model == "fisheye"
