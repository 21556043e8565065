"""A sensor that is known by its pictures alone: no dome, no camera matrix, nothing in millimetres."""

from __future__ import annotations

import hashlib
from typing import Literal

import msgspec


class PictureCamera(msgspec.Struct, frozen=True):
    """Size of the images in pixels, and their rate."""

    width: int
    height: int
    fps: float = 30.0


class PictureMarkers(msgspec.Struct, frozen=True):
    """Known properties of the markers: about how large, how many, and in which layout; None is measured.

    layout: ``hexagonal`` is a marker in the middle and 6 k markers at k steps about it; ``any`` is any other.
    """

    diameter_px: float | None = None
    count: int | None = None
    layout: Literal["hexagonal", "any"] = "any"


class LabelAxes(msgspec.Struct, frozen=True):
    """Axes of a table's labels: direction of its x axis in the image, in degrees from the image's right
    towards its bottom, and whose sideways motion and turn its shear and torsion are."""

    x_axis_deg: float = 0.0
    motion_of: Literal["object", "sensor"] = "object"


class PictureSensor(msgspec.Struct, frozen=True):
    """The content of a pose dataset's ``sensor.toml``; other keys are ignored."""

    camera: PictureCamera
    markers: PictureMarkers = PictureMarkers()
    labels: LabelAxes | msgspec.UnsetType = msgspec.UNSET

    @property
    def image_size_px(self) -> tuple[int, int]:
        """Width and height of the images."""
        return self.camera.width, self.camera.height

    def fingerprint(self) -> str:
        """Return 16 hex digits that depend on every value of the description except the frame rate."""
        at_any_rate = msgspec.structs.replace(self, camera=msgspec.structs.replace(self.camera, fps=0.0))
        return hashlib.sha256(msgspec.json.encode(at_any_rate)).hexdigest()[:16]


def hexagonal_counts(most: int) -> list[int]:
    """Return the numbers of markers, up to `most`, that fill a hexagon: 1, 7, 19, 37 and so on."""
    counts, steps = [1], 1
    while counts[-1] + 6 * steps <= most:
        counts.append(counts[-1] + 6 * steps)
        steps += 1
    return counts
