"""Read and check sensor.toml, the description of a sensor."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

import msgspec
import numpy as np

from palpate_edge.common.config_file import read_toml
from palpate_edge.common.errors import DatasetError
from palpate_edge.geometry.points import spacing
from palpate_edge.geometry.sensor import Markers, Sensor, bead_layout_mm

MOST_BEADS_IN_A_RING = 1000
MOST_BEADS = 2000  # of all rings
MARKER_COUNTS = range(7, 701)  # of a layout to learn
IMAGE_SIDE_PX = range(16, 8193)

Check = tuple[str, object, bool, str]
"""A key of sensor.toml, its value, whether it is allowed, and what is."""


def read_sensor(path: Path) -> Sensor:
    """Read a ``sensor.toml``. Raises DatasetError with the file, the key and what is allowed."""
    guide = "docs/press-dataset.md lists the keys of a sensor"
    sensor = read_toml(path, Sensor, guide=guide, error=DatasetError, trusted=False)
    refuse_out_of_range(path, _checks(sensor))
    _check_rings(path, sensor.markers)
    return sensor


def refuse_out_of_range(path: Path, checks: Iterable[Check]) -> None:
    """Raise DatasetError for the first check of a sensor.toml that failed."""
    for key, value, is_allowed, allowed in checks:
        if not is_allowed:
            raise DatasetError(f"{path}: {key} = {value} is out of range: it must be {allowed}")


def picture_checks(width: int, height: int, fps: float) -> list[Check]:
    """Return the checks of the pictures' size and rate, which every kind of sensor has."""
    return [
        ("camera.width", width, width in IMAGE_SIDE_PX, "16 to 8192"),
        ("camera.height", height, height in IMAGE_SIDE_PX, "16 to 8192"),
        ("camera.fps", fps, 0 < fps <= 1000, "above 0 and at most 1000"),
    ]


def _check_rings(path: Path, markers: Markers) -> None:
    """Refuse rings of too many beads, and beads that lie in each other."""
    count = sum(ring.count for ring in markers.rings)
    if count > MOST_BEADS:
        raise DatasetError(f"{path}: markers.rings have {count} beads: at most {MOST_BEADS} are allowed")
    nearest_mm = spacing(bead_layout_mm(markers)[0]) if count > 1 else np.array([math.inf])
    if nearest_mm.min() < 0.5 * markers.diameter_mm:
        raise DatasetError(
            f"{path}: two beads of markers.rings are {nearest_mm.min():.2f} mm apart, less than half of "
            f"markers.diameter_mm = {markers.diameter_mm:g}: correct theta_deg, count and phi0_deg"
        )


def _checks(sensor: Sensor) -> list[Check]:
    """Return the checks of sizes that TOML's types leave open."""
    dome, markers, camera = sensor.dome, sensor.markers, sensor.camera
    radius_mm, wall_mm = dome.outer_radius_mm, dome.wall_mm
    lens = (4,) if camera.model == "fisheye" else (4, 5, 8)
    rings = [
        check
        for number, ring in enumerate(markers.rings)
        for check in (
            (
                f"markers.rings[{number}].count",
                ring.count,
                0 < ring.count <= MOST_BEADS_IN_A_RING,
                f"1 to {MOST_BEADS_IN_A_RING}",
            ),
            (f"markers.rings[{number}].theta_deg", ring.theta_deg, 0 <= ring.theta_deg <= 180, "0 to 180"),
            (f"markers.rings[{number}].phi0_deg", ring.phi0_deg, math.isfinite(ring.phi0_deg), "finite"),
        )
    ]
    return [
        ("dome.outer_radius_mm", radius_mm, 0 < radius_mm < math.inf, "above 0"),
        (
            "dome.wall_mm",
            wall_mm,
            0 < wall_mm < radius_mm,
            f"above 0, below outer_radius_mm {radius_mm:g}",
        ),
        (
            "markers.radius_mm",
            markers.radius_mm,
            0 < markers.radius_mm <= radius_mm,
            f"above 0 and at most dome.outer_radius_mm {radius_mm:g}",
        ),
        (
            "markers.diameter_mm",
            markers.diameter_mm,
            0 < markers.diameter_mm < markers.radius_mm,
            f"above 0 and below markers.radius_mm {markers.radius_mm:g}",
        ),
        *rings,
        *_layout_checks(sensor),
        *picture_checks(camera.width, camera.height, camera.fps),
        (
            "camera.matrix",
            list(camera.matrix),
            min(camera.matrix[:2]) > 0 and _all_finite(camera.matrix),
            "fx, fy, cx, cy in pixels, finite, fx and fy above 0",
        ),
        (
            "camera.distortion",
            list(camera.distortion),
            len(camera.distortion) in lens and _all_finite(camera.distortion),
            f"{' or '.join(map(str, lens))} finite coefficients of the {camera.model} model",
        ),
        ("camera.position_mm", list(camera.position_mm), _all_finite(camera.position_mm), "finite"),
    ]


def _layout_checks(sensor: Sensor) -> list[Check]:
    """Checks of the declared number of beads: of a layout to learn, or of the rings."""
    count, rings = sensor.markers.count, sensor.markers.rings
    if isinstance(count, msgspec.UnsetType):
        return []
    if not rings:
        allowed = f"{MARKER_COUNTS[0]} to {MARKER_COUNTS[-1]}, or left out"
        return [("markers.count", count, count in MARKER_COUNTS, allowed)]
    drawn = sum(ring.count for ring in rings)
    return [("markers.count", count, count == drawn, f"{drawn} as markers.rings add up to, or left out")]


def _all_finite(values: tuple[float, ...]) -> bool:
    return all(math.isfinite(value) for value in values)
