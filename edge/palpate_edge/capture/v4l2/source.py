"""A V4L2 camera as a capture source: opened, configured, and read frame by frame."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import msgspec

from palpate_edge.capture.v4l2.controls import FixedExposure, exposure_us, lock_controls
from palpate_edge.capture.v4l2.device import VideoDevice
from palpate_edge.capture.v4l2.formats import PixelCode, decode
from palpate_edge.capture.v4l2.negotiate import RATE_TOLERANCE, Agreement, negotiate, reaches
from palpate_edge.capture.v4l2.stream import BufferStream, RawFrame
from palpate_edge.common.arrays import Image
from palpate_edge.common.errors import CameraStalledError
from palpate_edge.common.frame import Frame
from palpate_edge.common.local_clock import LocalClock

MEASURE_RATE_OVER_US = 1_000_000
SEQUENCE_WRAP = 1 << 32
STALLED_AFTER_PERIODS = 10
STALLED_AFTER_AT_LEAST_S = 0.5  # a camera needs this long for its first frame


class CameraSettings(msgspec.Struct, frozen=True):
    """The requested stream. code: None for the first format that reaches fps; grey: convert images to
    grey."""

    width: int
    height: int
    fps: float
    code: PixelCode | None
    grey: bool
    fixed: FixedExposure


class V4l2Source:
    """Frames of one camera; implements `palpate_edge.capture.source.Source`.

    report: called with one line for each setting that differs from the request.
    damaged: frames that the driver flagged or that were incomplete. measured_fps: measured over the first
    second, None until then.
    """

    def __init__(
        self, path: Path, settings: CameraSettings, clock: LocalClock, report: Callable[[str], None]
    ) -> None:
        """Raises CameraLostError when there is no camera, CaptureError when it cannot deliver this stream."""
        self._settings = settings
        self._clock = clock
        self._report = report
        self._name = str(path)
        self._timeout_s = max(STALLED_AFTER_AT_LEAST_S, STALLED_AFTER_PERIODS / settings.fps)
        self._device = VideoDevice(path)
        try:
            self.agreement = self._set_up()
            self.exposure_us = exposure_us(self._device)
            self._stream = BufferStream(self._device)
        except Exception:
            self._device.close()
            raise
        self.dropped = 0
        self.damaged = 0
        self.measured_fps: float | None = None
        self._last_sequence: int | None = None
        self._sequence = -1
        self._first_us = 0
        self._reported_stamps = False

    def read(self) -> Frame | None:
        """Wait for the next complete frame and return it. Raises CameraStalledError and CameraLostError."""
        frames: list[Frame] = []
        deadline_s = time.monotonic() + self._timeout_s
        while not frames:
            left_s = deadline_s - time.monotonic()
            if left_s <= 0:
                raise CameraStalledError(
                    f"camera {self._name} gave no whole frame for {self._timeout_s:.2f} s "
                    f"({self.damaged} damaged): check its cable and USB bandwidth; it is being reopened"
                )
            self._stream.read(left_s, lambda raw: self._use(raw, frames))
        return frames[0]

    def close(self) -> None:
        """Stop the stream and close the device."""
        self._stream.close()
        self._device.close()

    def _use(self, raw: RawFrame, frames: list[Frame]) -> None:
        dropped = self._count(raw.sequence)
        self.dropped += dropped
        image = None if raw.damaged else decode(raw.data, self.agreement.layout, grey=self._settings.grey)
        if image is None:
            self.damaged += 1
            self.dropped += 1
            return
        exposed_at_us = self._exposed_at_us(raw)
        self._measure_rate(exposed_at_us)
        frames.append(self._frame(image, exposed_at_us))

    def _frame(self, image: Image, exposed_at_us: int) -> Frame:
        return Frame(image, exposed_at_us, self._sequence, f"{self._name}#{self._sequence}")

    def _count(self, sequence: int) -> int:
        """Return the number of frames missed before this one; 0 for a driver that does not count frames."""
        step = 1 if self._last_sequence is None else (sequence - self._last_sequence) % SEQUENCE_WRAP
        if not 0 < step < SEQUENCE_WRAP // 2:
            step = 1
        self._last_sequence = sequence
        self._sequence += step
        return step - 1

    def _exposed_at_us(self, raw: RawFrame) -> int:
        if raw.stamp_us is not None:
            return self._clock.at_monotonic_us(raw.stamp_us)
        if not self._reported_stamps:
            self._reported_stamps = True
            self._report(
                f"camera {self._name} has no monotonic time stamps: exposures are stamped on arrival"
            )
        return self._clock.now_us()

    def _set_up(self) -> Agreement:
        wanted = self._settings
        agreement = negotiate(self._device, wanted.width, wanted.height, wanted.fps, wanted.code)
        for finding in lock_controls(self._device, wanted.fixed):
            self._report(f"camera {self._name}: {finding}")
        if not reaches(agreement.fps, wanted.fps):
            given = "an unknown rate" if agreement.fps is None else f"{agreement.fps:.1f} frames/s"
            self._report(f"camera {self._name} gives {given}, {wanted.fps:.1f} frames/s were requested")
        return agreement

    def _measure_rate(self, exposed_at_us: int) -> None:
        """Measure the rate of exposures once, over the first second; missed frames count."""
        if self.measured_fps is not None:
            return
        if self._sequence == 0 or not self._first_us:
            self._first_us = exposed_at_us
            self._first_sequence = self._sequence
            return
        elapsed_us = exposed_at_us - self._first_us
        if elapsed_us < MEASURE_RATE_OVER_US:
            return
        self.measured_fps = 1e6 * (self._sequence - self._first_sequence) / elapsed_us
        promised = self.agreement.fps or self._settings.fps
        if abs(self.measured_fps - promised) > RATE_TOLERANCE * promised:
            self._report(
                f"camera {self._name} gives {self.measured_fps:.1f} frames/s, its driver reported "
                f"{promised:.1f}: shorten the exposure, or request that rate"
            )
