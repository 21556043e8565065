"""Reader of a fingertip's ring of frames, a file in shared memory that the camera's process writes.

The layout is that of palpate's `frame_ring.py`. A slot is copied and used only if its stamp was that of a
complete frame before and after the copy.
"""

from __future__ import annotations

import mmap
import struct
import threading
import time
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lerobot_robot_palpate.control_socket import PalpateHandError

HEADER = struct.Struct("<8sIIIII4x16s")
WORD = struct.Struct("<Q")
MAGIC, VERSION = b"PALPRING", 1
COUNT_AT, HEADER_BYTES, PAGE = 48, 64, 4096
TRIES = 8
SILENCE_S = 3.0
"""A camera without a new frame for this time counts as failed."""

Picture = NDArray[np.uint8]


class PictureRing:
    """The newest picture of one camera, RGB."""

    def __init__(self, path: Path) -> None:
        """Map the file. Raises PalpateHandError when it is missing or no ring of this version."""
        try:
            with path.open("rb") as file:
                self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
            magic, version, self._slots, width, height, channels, _ = HEADER.unpack_from(self._map, 0)
        except (OSError, ValueError, struct.error) as error:
            raise PalpateHandError(
                f"{path}: no ring of frames: start the program that writes it first"
            ) from error
        if magic != MAGIC or version != VERSION:
            raise PalpateHandError(
                f"{path}: no ring of frames of version {VERSION}: use palpate's own version"
            )
        self.shape = (height, width, 3)
        self._path, self._stored = path, (height, width, channels)
        self._to_rgb = cv2.COLOR_GRAY2RGB if channels == 1 else cv2.COLOR_BGR2RGB
        self._slot_bytes = -(-(HEADER_BYTES + height * width * channels) // PAGE) * PAGE
        self._barrier = threading.Lock()
        self._count, self._at_s = -1, time.monotonic()

    def newest(self) -> Picture:
        """Return the newest frame, (height, width, 3). Raises PalpateHandError when the camera sends none."""
        count = 0
        for _ in range(TRIES):
            (count,) = WORD.unpack_from(self._map, COUNT_AT)
            picture = self._copy(count - 1) if count else None
            if picture is not None:
                self._check_progress(count)
                return picture
        raise PalpateHandError(f"{self._path}: no complete frame ({count} written): is its camera running?")

    def _check_progress(self, count: int) -> None:
        now_s = time.monotonic()
        if count != self._count:
            self._count, self._at_s = count, now_s
        elif now_s - self._at_s > SILENCE_S:
            raise PalpateHandError(f"{self._path}: no new frame for {SILENCE_S:g} s: is its camera running?")

    def _copy(self, number: int) -> Picture | None:
        """Return a frame; None when the writer has overwritten it meanwhile."""
        at = HEADER_BYTES + number % self._slots * self._slot_bytes
        (stamp,) = WORD.unpack_from(self._map, at)
        with self._barrier:  # orders the copy after the stamp on every processor
            size = int(np.prod(self._stored))
            pixels = np.frombuffer(self._map, np.uint8, size, at + HEADER_BYTES).reshape(self._stored)
            picture = np.asarray(cv2.cvtColor(pixels, self._to_rgb), np.uint8)
        if stamp != 2 * number + 2 or WORD.unpack_from(self._map, at)[0] != stamp:
            return None
        return picture
