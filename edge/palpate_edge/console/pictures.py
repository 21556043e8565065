"""Pictures of a fingertip as a page shows them: JPEG, and the beads of a sensor without calibration."""

from __future__ import annotations

import time

import cv2
import numpy as np

from palpate_edge.common.arrays import Image
from palpate_edge.common.contact import Contact
from palpate_edge.console.events import ConsoleFrame
from palpate_edge.daemon.watching.watch_messages import PLACE_DIGITS, BeadsShown
from palpate_edge.vision.appearance import Appearance, plane
from palpate_edge.vision.blob_detection import find_blobs
from palpate_edge.vision.unknown_layout import beads_without_layout

WIDEST_PX = 640
JPEG_OPTIONS = (cv2.IMWRITE_JPEG_QUALITY, 75)
SEARCH_EVERY_S = 2.0
"""The search for beads of unknown size and colour takes about 100 ms; between searches the size is known."""
WEAKEST_SHARE = 0.5


def console_frame(
    image: Image, contact: Contact, latency_ms: float, beads: BeadsShown | None, widest_px: int = WIDEST_PX
) -> ConsoleFrame:
    """Return a frame to show. image: (height, width) or (height, width, 3)."""
    height, width = image.shape[:2]
    return ConsoleFrame(contact, latency_ms, beads, (width, height), jpeg_of(image, widest_px))


def jpeg_of(image: Image, widest_px: int = WIDEST_PX) -> bytes:
    """Return an image, (height, width) or (height, width, 3), as a JPEG of at most `widest_px` width."""
    height, width = image.shape[:2]
    shown = image
    if width > widest_px:
        size = widest_px, max(1, round(height * widest_px / width))
        shown = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    _, jpeg = cv2.imencode(".jpg", shown, JPEG_OPTIONS)
    return jpeg.tobytes()


class LooseBeads:
    """Finds the blobs that look like beads, without a calibration, to show what the camera sees."""

    def __init__(self) -> None:
        self._search_at_s = 0.0
        self._appearance, self._diameter_px, self._count, self._weakest = Appearance(), 0.0, 0, 0.0

    def find(self, image: Image) -> BeadsShown:
        """Return the beads of an image; every one counts as at rest."""
        if time.monotonic() >= self._search_at_s:
            blobs, self._appearance, self._diameter_px = beads_without_layout(image)
            self._search_at_s = time.monotonic() + SEARCH_EVERY_S
            self._count = len(blobs.strength)
            self._weakest = WEAKEST_SHARE * float(blobs.strength.min()) if self._count else 0.0
        elif self._count:
            dark = plane(image, self._appearance)
            blobs = find_blobs(dark, self._diameter_px, self._weakest, most=self._count)
        else:
            return BeadsShown([], [], [])
        places = blobs.position_px.round(PLACE_DIGITS).tolist()
        return BeadsShown(places, places, [])
