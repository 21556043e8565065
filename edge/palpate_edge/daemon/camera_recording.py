"""A recording without a daemon: this process takes the camera, with or without a calibration."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from palpate_edge.can_bus.simulated_clock import clock_of
from palpate_edge.common.errors import CaptureError
from palpate_edge.daemon.capture_factory import open_source
from palpate_edge.daemon.config import FingertipConfig
from palpate_edge.daemon.estimator_factory import configured_calibration
from palpate_edge.datasets.recorder import FrameRing, RingLimits


def record_camera(
    config: FingertipConfig,
    folder: Path,
    stopped: threading.Event,
    report: Callable[[str], None],
    *,
    frames: int | None = None,
    seconds: float | None = None,
) -> int:
    """Record the camera's frames to `folder` until `stopped`, `frames` or `seconds`; return how many.

    The limits of [record] apply. report: takes one line for each setting that differs from the request.
    Raises CaptureError, DatasetError or CalibrationError.
    """
    ring = FrameRing(folder, RingLimits(config.record.megabytes * 1_000_000, config.record.seconds))
    written, first_us = 0, 0
    with closing(open_source(config, configured_calibration(config), clock_of(config.bus), report)) as source:
        while not stopped.is_set() and (frames is None or written < frames):
            frame = source.read()
            if frame is None:
                break
            first_us = first_us if written else frame.exposed_at_us
            if seconds is not None and frame.exposed_at_us - first_us >= 1e6 * seconds:
                break
            ring.add(frame)
            written += 1
    ring.write_index()
    if not written:
        raise CaptureError(f"{config.name}: the camera gave no frame: see palpate-edge check")
    return written
