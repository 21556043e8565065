"""The sources of the external camera's pictures: a video, a folder of pictures, or a USB camera (V4L2)."""

from __future__ import annotations

import csv
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np

from palpate_edge.capture.v4l2.controls import FixedExposure
from palpate_edge.capture.v4l2.source import CameraSettings, V4l2Source
from palpate_edge.common.arrays import Image
from palpate_edge.common.errors import ConfigError
from palpate_edge.common.local_clock import LocalClock
from palpate_edge.datasets.recorder import INDEX
from palpate_edge.datasets.recording import open_recording


def is_camera(source: Path) -> bool:
    """Return whether the source is a device node, such as /dev/v4l/by-path/...; all others are recordings."""
    return source.is_char_device()


def recorded_frames(source: Path, start_us: int = 0) -> Iterator[tuple[int, Image]]:
    """Yield (exposed_at_us, grey picture) of a recording. Raises DatasetError when it is none.

    The exposure times are those of a folder of ``palpate-edge record``; for other recordings they follow from
    the frame rate, starting at `start_us`.
    """
    recording = open_recording(source)
    exposed = _exposures(source)
    with closing(recording):
        for index in range(recording.count):
            picture, name = recording.read(index)
            yield exposed.get(name, start_us + round(index * 1e6 / recording.fps)), _grey(picture)


def camera_frames(
    device: Path,
    size_px: tuple[int, int],
    fps: float,
    exposure_us: int | None,
    stopped: threading.Event,
    duration_s: float | None,
) -> Iterator[tuple[int, Image]]:
    """Yield (exposed_at_us, grey picture) of a camera until `stopped` is set or for `duration_s`.

    The kernel provides the times. exposure_us: a fixed exposure, None for the camera's present one; automatic
    exposure is switched off in both cases. Raises CaptureError when the camera is lost or lacks the format.
    """
    width, height = size_px
    settings = CameraSettings(
        width, height, fps, None, grey=True, fixed=FixedExposure(exposure_us, None, None)
    )
    end_s = None if duration_s is None else time.monotonic() + duration_s
    with closing(V4l2Source(device, settings, LocalClock(), lambda _: None)) as source:
        while not stopped.is_set() and (end_s is None or time.monotonic() < end_s):
            frame = source.read()
            if frame is None:
                return
            yield frame.exposed_at_us, frame.image


def _exposures(folder: Path) -> dict[str, int]:
    try:
        with (folder / INDEX).open(newline="") as file:
            return {row["frame"]: int(row["exposed_at_us"]) for row in csv.DictReader(file)}
    except (FileNotFoundError, NotADirectoryError):
        return {}
    except (OSError, KeyError, ValueError) as exc:
        raise ConfigError(
            f"{folder / INDEX}: no index of recorded frames ({exc}): remove or correct it"
        ) from exc


def _grey(picture: Image) -> Image:
    if picture.ndim == 2:
        return picture
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
