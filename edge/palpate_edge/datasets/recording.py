"""Recorded frames as a capture source: a folder of images, a press dataset or a video file.

:func:`all_frames` gives every frame, as fast as they are read. :class:`RealTimeSource` plays them as a
camera would: frame k is exposed at start + k / fps; a late reader misses frames, and their sequence numbers
show it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from palpate_edge.common.arrays import Image
from palpate_edge.common.errors import CaptureError, DatasetError
from palpate_edge.common.frame import Frame
from palpate_edge.datasets.images import IMAGE_SUFFIXES, VIDEO_SUFFIXES, list_images, read_image
from palpate_edge.datasets.press_dataset import is_dataset, read_dataset
from palpate_edge.datasets.recorder import recorded_fps
from palpate_edge.geometry.sensor import Sensor

DEFAULT_FPS = 30.0


class Recording(Protocol):
    """Frames of a recording, in order.

    count: how many; fps: at which rate they were taken; sensor: the description, where there is one.
    """

    @property
    def count(self) -> int: ...

    @property
    def fps(self) -> float: ...

    @property
    def sensor(self) -> Sensor | None: ...

    def read(self, index: int) -> tuple[Image, str]:
        """Frame `index` and its name. Raises DatasetError when it cannot be read."""
        ...

    def close(self) -> None: ...


@dataclass(slots=True)
class ImageRecording:
    """Image files, one a frame."""

    paths: list[Path]
    fps: float
    sensor: Sensor | None
    grey: bool = True

    @property
    def count(self) -> int:
        return len(self.paths)

    def read(self, index: int) -> tuple[Image, str]:
        path = self.paths[index]
        return read_image(path, grey=self.grey), path.name

    def close(self) -> None:
        """Nothing is held open between frames."""


class VideoRecording:
    """A video file; cheap to read forwards."""

    def __init__(self, path: Path, sensor: Sensor | None = None) -> None:
        self._path = path
        self._video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
        self.count = int(self._video.get(cv2.CAP_PROP_FRAME_COUNT)) if self._video.isOpened() else 0
        if self.count <= 0:
            raise DatasetError(f"{path} is not a video that can be decoded: record or copy it again")
        self.fps = float(self._video.get(cv2.CAP_PROP_FPS)) or DEFAULT_FPS
        self.sensor = sensor
        self._next = 0

    def read(self, index: int) -> tuple[Image, str]:
        if index < self._next:
            self._video.set(cv2.CAP_PROP_POS_FRAMES, 0)
            self._next = 0
        while self._next < index and self._video.grab():
            self._next += 1
        ok, image = self._video.read()
        if not ok:
            raise DatasetError(
                f"{self._path} ends at frame {self._next} of {self.count}: record or copy the whole video "
                "again"
            )
        self._next += 1
        return np.asarray(image, dtype=np.uint8), f"{self._path.name}#{index}"

    def close(self) -> None:
        self._video.release()


def open_recording(path: Path, *, grey: bool = True) -> Recording:
    """Open a press dataset (its frames/ in name order, or its frames.mp4), a folder of images, an image or a
    video. Raises DatasetError with what was expected."""
    if path.is_file() and path.suffix.lower() in VIDEO_SUFFIXES:
        return VideoRecording(path)
    if path.is_file() and path.suffix.lower() in IMAGE_SUFFIXES:
        return ImageRecording([path], DEFAULT_FPS, None, grey)
    if path.is_file():
        raise DatasetError(
            f"{path} is not an image or a video: give a .png, .jpg, .mp4 or .avi file, or a folder"
        )
    if is_dataset(path):
        return _open_dataset(path, grey)
    return ImageRecording(list_images(path), recorded_fps(path) or DEFAULT_FPS, None, grey)


def _open_dataset(folder: Path, grey: bool) -> Recording:
    dataset = read_dataset(folder)
    fps = dataset.sensor.camera.fps
    videos = sorted(path for path in folder.glob("frames.*") if path.suffix.lower() in VIDEO_SUFFIXES)
    if videos:
        return VideoRecording(videos[0], dataset.sensor)
    return ImageRecording(list_images(folder / "frames"), fps, dataset.sensor, grey)


def all_frames(recording: Recording) -> Iterator[Frame]:
    """Every frame once; exposure times are those of the recording, from 0."""
    for index in range(recording.count):
        image, name = recording.read(index)
        yield Frame(image, round(index * 1e6 / recording.fps), index, name)


class RealTimeSource:
    """Plays a recording at its own rate, dropping what the reader is too slow for.

    clock_us, sleep_s: replaced by tests. With `loop` the recording starts over at its
    end.
    """

    def __init__(
        self,
        recording: Recording,
        *,
        loop: bool = False,
        clock_us: Callable[[], int] = lambda: time.time_ns() // 1000,
        sleep_s: Callable[[float], None] = time.sleep,
    ) -> None:
        self._recording = recording
        self._loop = loop
        self._clock_us = clock_us
        self._sleep_s = sleep_s
        self._start_us: int | None = None
        self._next = 0
        self.dropped = self.damaged = 0
        self.exposure_us = 0

    def read(self) -> Frame | None:
        """Wait for the next exposure and give its frame; None at the end of the recording."""
        now = self._clock_us()
        if self._start_us is None:
            self._start_us = now
        period_us = 1e6 / self._recording.fps
        current = int((now - self._start_us) / period_us)  # the frame being exposed now
        if not self._loop:
            current = min(current, self._recording.count)  # after the end nothing is dropped
        if current > self._next:
            self.dropped += current - self._next
            self._next = current
        sequence = self._next
        if sequence >= self._recording.count and not self._loop:
            return None
        exposed_at_us = self._start_us + round(sequence * period_us)
        try:  # decoded before it is exposed: what that takes is not a camera's
            image, name = self._recording.read(sequence % self._recording.count)
        except DatasetError as error:
            raise CaptureError(f"the recording stopped: {error}") from error
        now = self._clock_us()
        if exposed_at_us > now:
            self._sleep_s((exposed_at_us - now) / 1e6)
        self._next = sequence + 1
        return Frame(image, exposed_at_us, sequence, name)

    def close(self) -> None:
        self._recording.close()
