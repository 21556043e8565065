"""Frames from another process on this machine, through a ring in shared memory (frame_ring.py)."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from palpate_edge.capture.frame_ring import RingFormat, RingReader
from palpate_edge.common.errors import CameraLostError, CameraStalledError, CaptureError
from palpate_edge.common.frame import Frame
from palpate_edge.common.local_clock import monotonic_us
from palpate_edge.geometry.sensor import Sensor

POLL_S = 0.001
QUIET_SHARE = 0.7  # of the time between two exposures, in which no next frame is looked for
STALLED_AFTER_S = 0.5


class SharedMemorySource:
    """The newest frame each time; those that were overtaken count as dropped.

    at_monotonic_us: from CLOCK_MONOTONIC to the daemon's clock; now_us: that clock. A writer that stops, or
    starts again, is noticed as a stall: open the source again.
    """

    def __init__(
        self,
        path: Path,
        sensor: Sensor,
        at_monotonic_us: Callable[[int], int],
        now_us: Callable[[], int] = monotonic_us,
    ) -> None:
        """Raises CameraLostError where there is no ring, CaptureError for another sensor or image size."""
        try:
            self._reader = RingReader(path)
        except FileNotFoundError:
            raise CameraLostError(
                f"{path} is missing: start what writes frames there (palpate-host simulate camera)"
            ) from None
        try:
            _check(self._reader.format, sensor, path)
        except CaptureError:
            self._reader.close()
            raise
        self._path, self._at_monotonic_us, self._now_us = path, at_monotonic_us, now_us
        self._next_sequence: int | None = None
        self._last_exposed_us = 0
        self._shortest_us = 0
        self._quiet_until_s = 0.0
        self.dropped = 0
        self.exposure_us = 0

    def read(self) -> Frame | None:
        """Wait for the next frame. Raises CameraStalledError when none comes for STALLED_AFTER_S."""
        deadline_us = self._now_us() + round(1e6 * STALLED_AFTER_S)
        while (frame := self._reader.newest()) is None:
            if self._now_us() > deadline_us:
                raise CameraStalledError(
                    f"{self._path}: no frame for {STALLED_AFTER_S:g} s: look whether its writer still runs"
                )
            time.sleep(max(POLL_S, self._quiet_until_s - time.monotonic()))
        if self._next_sequence is not None:
            self.dropped += max(0, frame.sequence - self._next_sequence)
            self._be_quiet(frame.exposed_at_us - self._last_exposed_us)
        self._next_sequence = frame.sequence + 1
        self._last_exposed_us = frame.exposed_at_us
        exposed_at_us = self._at_monotonic_us(frame.exposed_at_us)
        return Frame(frame.image, exposed_at_us, frame.sequence, f"{self._path.name}#{frame.sequence}")

    def _be_quiet(self, period_us: int) -> None:
        """A thousand looks a second cost more than the estimate: none for most of the shortest gap."""
        period_us = min(max(0, period_us), round(1e6 * STALLED_AFTER_S))
        self._shortest_us = min(self._shortest_us or period_us, period_us)
        self._quiet_until_s = time.monotonic() + QUIET_SHARE * 1e-6 * self._shortest_us

    def close(self) -> None:
        self._reader.close()


def _check(form: RingFormat, sensor: Sensor, path: Path) -> None:
    if (form.width, form.height) != sensor.image_size_px:
        width, height = sensor.image_size_px
        raise CaptureError(
            f"{path} has frames of {form.width}x{form.height}, the calibration is of {width}x{height}: name "
            "the ring of its sensor"
        )
    if form.fingerprint and form.fingerprint != sensor.fingerprint():
        raise CaptureError(
            f"{path} has frames of sensor {form.fingerprint}, the calibration is of {sensor.fingerprint()}: "
            "name the ring of its sensor, or calibrate that one"
        )
