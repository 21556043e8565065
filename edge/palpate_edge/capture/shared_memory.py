"""Frames from another process on this machine, through a ring in shared memory (frame_ring.py)."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from palpate_edge.capture.frame_ring import RingFormat, RingReader
from palpate_edge.common.errors import CameraLostError, CameraStalledError, CaptureError
from palpate_edge.common.frame import Frame
from palpate_edge.common.local_clock import monotonic_us
from palpate_edge.geometry.picture_sensor import PictureSensor
from palpate_edge.geometry.sensor import Sensor

POLL_S = 0.001
QUIET_SHARE = 0.7  # share of the frame period without polling after a frame
STALLED_AFTER_S = 0.5


class SharedMemorySource:
    """Reads the newest frame of a ring; frames that were overwritten before count as dropped.

    at_monotonic_us: converts CLOCK_MONOTONIC to the daemon's clock; now_us: the daemon's clock. A writer that
    stops or restarts appears as a stall; opening the source again finds the new ring.
    """

    def __init__(
        self,
        path: Path,
        sensor: Sensor | PictureSensor | None,
        at_monotonic_us: Callable[[int], int],
        now_us: Callable[[], int] = monotonic_us,
    ) -> None:
        """sensor: that the frames must be of; None for any. Raises CameraLostError when there is no ring,
        CaptureError for another sensor or image size."""
        try:
            self._reader = RingReader(path)
        except FileNotFoundError:
            raise CameraLostError(
                f"{path} is missing: start the program that writes it (palpate-host simulate camera)"
            ) from None
        try:
            if sensor is not None:
                _check(self._reader.format, sensor, path)
        except CaptureError:
            self._reader.close()
            raise
        self._path, self._at_monotonic_us, self._now_us = path, at_monotonic_us, now_us
        self._next_sequence: int | None = None
        self._last_exposed_us = 0
        self._shortest_us = 0
        self._poll_from_s = 0.0
        self.dropped = 0
        self.damaged = 0  # the ring's stamps show torn frames, which are read again
        self.exposure_us = 0

    def read(self) -> Frame | None:
        """Wait for the next frame and return it. Raises CameraStalledError after STALLED_AFTER_S without
        one."""
        deadline_us = self._now_us() + round(1e6 * STALLED_AFTER_S)
        while (frame := self._reader.newest()) is None:
            if self._now_us() > deadline_us:
                raise CameraStalledError(
                    f"{self._path}: no frame for {STALLED_AFTER_S:g} s: check that its writer runs"
                )
            time.sleep(max(POLL_S, self._poll_from_s - time.monotonic()))
        if self._next_sequence is not None:
            self.dropped += max(0, frame.sequence - self._next_sequence)
            self._pause_polling(frame.exposed_at_us - self._last_exposed_us)
        self._next_sequence = frame.sequence + 1
        self._last_exposed_us = frame.exposed_at_us
        exposed_at_us = self._at_monotonic_us(frame.exposed_at_us)
        return Frame(frame.image, exposed_at_us, frame.sequence, f"{self._path.name}#{frame.sequence}")

    def _pause_polling(self, period_us: int) -> None:
        """Skip polling for most of the shortest frame period: polling at 1 kHz costs more than the
        estimate."""
        period_us = min(max(0, period_us), round(1e6 * STALLED_AFTER_S))
        self._shortest_us = min(self._shortest_us or period_us, period_us)
        self._poll_from_s = time.monotonic() + QUIET_SHARE * 1e-6 * self._shortest_us

    def close(self) -> None:
        """Unmap the ring."""
        self._reader.close()


def _check(form: RingFormat, sensor: Sensor | PictureSensor, path: Path) -> None:
    if (form.width, form.height) != sensor.image_size_px:
        width, height = sensor.image_size_px
        raise CaptureError(
            f"{path} has frames of {form.width}x{form.height}, the calibration is for {width}x{height}: "
            "give the ring of the calibration's sensor"
        )
    if form.fingerprint and form.fingerprint != sensor.fingerprint():
        raise CaptureError(
            f"{path} has frames of sensor {form.fingerprint}, the calibration is for {sensor.fingerprint()}: "
            "give the ring of that sensor, or calibrate this one"
        )
