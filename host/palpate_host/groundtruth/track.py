"""The object's orientation and position over a video, by its marker and optionally one on the hand's base."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from palpate_edge.common.arrays import Array, Image
from palpate_edge.common.atomic_write import atomic_text
from palpate_edge.common.errors import ConfigError
from palpate_host.common import rotation
from palpate_host.groundtruth.intrinsics import Intrinsics
from palpate_host.groundtruth.marker import MarkerCamera, MarkerPose, Refusal

COLUMNS = (
    "time_us",
    "valid",
    "x_mm",
    "y_mm",
    "z_mm",
    "roll_deg",
    "pitch_deg",
    "yaw_deg",
    "reprojection_px",
    "reason",
)


@dataclass(frozen=True, slots=True)
class Marker:
    """An ArUco marker of the dictionary 4x4_50; side_m: of its black square."""

    number: int
    side_m: float


@dataclass(frozen=True, slots=True)
class ObjectSighting:
    """The object in one picture: its pose in the base's frame (the camera's without a base), or a reason.

    rotation: (3, 3), position_m: (3,), None without a pose. marker: its pose in the camera's frame, for
    drawing.
    """

    time_us: int
    rotation: Array | None
    position_m: Array | None
    marker: MarkerPose | None
    reason: str


class ObjectTracker:
    """The tracker of the object and its base. The base does not move: while hidden, its last pose is used."""

    def __init__(self, intrinsics: Intrinsics, marker: Marker, base: Marker | None = None) -> None:
        K, k = intrinsics.matrix_px, np.array(intrinsics.distortion)
        self._intrinsics = intrinsics
        self._object = MarkerCamera(K, marker.number, marker.side_m, k)
        self._base = None if base is None else MarkerCamera(K, base.number, base.side_m, k)
        self._base_pose: MarkerPose | None = None

    def look(self, time_us: int, picture: Image) -> ObjectSighting:
        """Measure the object in a grey picture (h, w)."""
        size = (picture.shape[1], picture.shape[0])
        expected = (self._intrinsics.width_px, self._intrinsics.height_px)
        if size != expected:
            reason = f"picture of {size[0]}x{size[1]}, the intrinsics are for {expected[0]}x{expected[1]}"
            return ObjectSighting(time_us, None, None, None, reason)
        if self._base is not None:
            base = self._base.measure(picture)
            if isinstance(base, MarkerPose):
                self._base_pose = base
            elif self._base_pose is None:
                return ObjectSighting(time_us, None, None, None, f"base: {base.reason}")
        seen = self._object.measure(picture)
        if isinstance(seen, Refusal):
            return ObjectSighting(time_us, None, None, None, seen.reason)
        if self._base_pose is None:
            return ObjectSighting(time_us, seen.rotation, seen.position_m, seen, "")
        back = self._base_pose.rotation.T
        place_m = back @ (seen.position_m - self._base_pose.position_m)
        return ObjectSighting(time_us, np.asarray(back @ seen.rotation), np.asarray(place_m), seen, "")


def turns(sights: Iterable[ObjectSighting]) -> Iterator[tuple[ObjectSighting, Array | None]]:
    """Yield each sighting with the turn (3, 3) since the first pose, about the axes of the base."""
    start: Array | None = None
    for sight in sights:
        if sight.rotation is None:
            yield sight, None
            continue
        start = sight.rotation if start is None else start
        yield sight, np.asarray(sight.rotation @ start.T)


def write_csv(path: Path, sights: Sequence[ObjectSighting]) -> None:
    """Write COLUMNS.

    The turn is roll, pitch, yaw since the first pose. Raises ConfigError when writing fails.
    """
    with atomic_text(path, ConfigError) as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for sight, turn in turns(sights):
            row: list[object] = [sight.time_us, int(turn is not None), *[""] * 7, sight.reason]
            if turn is not None and sight.position_m is not None and sight.marker is not None:
                row[2:5] = [f"{1e3 * value:.3f}" for value in sight.position_m]
                row[5:8] = [f"{angle:.4f}" for angle in rotation.to_rpy_deg(turn)]
                row[8] = f"{sight.marker.reprojection_px:.3f}"
            writer.writerow(row)


def refusals(sights: Iterable[ObjectSighting]) -> dict[str, int]:
    """Return reason -> number of pictures without a pose."""
    found: dict[str, int] = {}
    for sight in sights:
        if sight.rotation is None:
            found[sight.reason] = found.get(sight.reason, 0) + 1
    return found


def draw(picture: Image, sight: ObjectSighting, intrinsics: Intrinsics, axis_m: float) -> Image:
    """Draw the marker's outline and axes (red x, green y, blue z), or the reason, into a colour copy."""
    drawn = cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)
    seen = sight.marker
    if seen is None:
        cv2.putText(drawn, sight.reason, (20, 40), cv2.FONT_HERSHEY_SIMPLEX, 0.8, (0, 0, 255), 2)
        return np.asarray(drawn, dtype=np.uint8)
    outline = np.rint(seen.corners_px).astype(np.int32).reshape(1, 4, 2)
    cv2.polylines(drawn, list(outline), isClosed=True, color=(0, 220, 220), thickness=2)
    k = np.array(intrinsics.distortion)
    turn, _ = cv2.Rodrigues(seen.rotation)
    cv2.drawFrameAxes(drawn, intrinsics.matrix_px, k, turn, seen.position_m, axis_m, 3)
    x, y, z = 1e3 * seen.position_m
    distance_mm = math.hypot(x, y, z)
    text = f"{distance_mm:.0f} mm away, misfit {seen.reprojection_px:.2f} px"
    cv2.putText(drawn, text, (20, 40), cv2.FONT_HERSHEY_SIMPLEX, 0.8, (0, 120, 0), 2)
    return np.asarray(drawn, dtype=np.uint8)
