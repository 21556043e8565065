"""Pictures of the fingertips' cameras for ROS, from rings in shared memory on the same machine."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping

import cv2

from palpate_edge.capture.frame_ring import RingReader
from palpate_edge.common.errors import ConfigError
from palpate_edge.common.local_clock import unix_ahead_us
from palpate_host.common.camera_source import CameraSource
from palpate_host.ros.contents import topic_name
from palpate_host.ros.message_contents import PictureContent

JPEG_QUALITY = 80
POLL_S = 0.005

Publish = Callable[[Iterable[PictureContent]], None]


class PictureFeed:
    """A thread that publishes each new picture of the given cameras; close it."""

    def __init__(self, cameras: Iterable[CameraSource], frames: Mapping[str, str], publish: Publish) -> None:
        """frames: finger -> frame of its pictures.

        Raises ConfigError for a camera of another name or without a ring, CaptureError for a file that is no
        ring.
        """
        self._publish, self._ended = publish, threading.Event()
        self._rings = [(_ring(camera, frames), camera.name, frames[camera.name]) for camera in cameras]
        self._thread = threading.Thread(target=self._run, name="pictures", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread and close the rings."""
        self._ended.set()
        self._thread.join()
        for ring, _, _ in self._rings:
            ring.close()

    def _run(self) -> None:
        while self._rings and not self._ended.wait(POLL_S):
            for ring, name, frame in self._rings:
                picture = _newest(ring, name, frame)
                if picture is not None:
                    self._publish([picture])


def _ring(camera: CameraSource, frames: Mapping[str, str]) -> RingReader:
    if camera.name not in frames:
        raise ConfigError(f"--camera {camera.name}: the hand's fingers are {', '.join(frames)}")
    return camera.open_ring()


def _newest(ring: RingReader, name: str, frame: str) -> PictureContent | None:
    """Return the newest picture, None when there is no new one. A ring's time is monotonic, ROS's is Unix
    time."""
    picture = ring.newest()
    if picture is None:
        return None
    _, jpeg = cv2.imencode(".jpg", picture.image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    exposed_us = picture.exposed_at_us + unix_ahead_us()
    return PictureContent(f"{topic_name(name)}/image_raw/compressed", exposed_us, frame, jpeg.tobytes())
