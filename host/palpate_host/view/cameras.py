"""Pictures of a fingertip's camera for the viewer: from a folder of ``palpate-edge record``, or a live
ring."""

from __future__ import annotations

import csv
from collections.abc import Iterator

import rerun as rr

from palpate_edge.common.errors import ConfigError
from palpate_edge.common.local_clock import unix_ahead_us
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.recorder import INDEX
from palpate_host.common.camera_source import CameraSource
from palpate_host.view.camera_beads import CameraBeads, Drawing

JPEG_QUALITY = 80

Picture = dict[str, rr.EncodedImage | rr.Image | Drawing]
"""Entity below the camera's, or "" for the picture itself -> what is shown there."""


def recorded_pictures(source: CameraSource, beads: CameraBeads | None) -> Iterator[tuple[int, Picture]]:
    """Yield (exposed_at_us, picture) in order. Raises ConfigError when the folder has no index."""
    index = source.path / INDEX
    try:
        with index.open(newline="") as file:
            rows = [(int(row["exposed_at_us"]), row["frame"]) for row in csv.DictReader(file)]
    except (OSError, KeyError, ValueError) as exc:
        raise ConfigError(
            f"{index}: no index of recorded frames ({exc}): give the folder of a recording"
        ) from exc
    for exposed_us, name in rows:
        path = source.path / name
        if path.exists():  # a recording that keeps the last frames only may have deleted it
            picture: Picture = {"": rr.EncodedImage(path=path)}
            if beads is not None:
                picture.update(beads.draw(read_image(path)))
            yield exposed_us, picture


class LiveCamera:
    """The newest picture of a ring in shared memory."""

    def __init__(self, source: CameraSource, beads: CameraBeads | None) -> None:
        """Open the ring. Raises ConfigError when the file is missing, CaptureError when it is no ring."""
        self.name, self._beads = source.name, beads
        self._ring = source.open_ring()

    def take(self) -> tuple[int, Picture] | None:
        """Return (exposed_at_us, picture), None when there is no new picture."""
        frame = self._ring.newest()
        if frame is None:
            return None
        # A ring's time is monotonic, the view's is Unix time.
        exposed_us = frame.exposed_at_us + unix_ahead_us()
        colours = rr.ColorModel.L if frame.image.ndim == 2 else rr.ColorModel.BGR
        shown = rr.Image(frame.image, color_model=colours).compress(jpeg_quality=JPEG_QUALITY)
        picture: Picture = {"": shown}
        if self._beads is not None:
            picture.update(self._beads.draw(frame.image))
        return exposed_us, picture

    def close(self) -> None:
        self._ring.close()
