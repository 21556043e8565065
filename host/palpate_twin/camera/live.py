"""Camera of a simulated fingertip in real time: a moving contact, rendered into a shared-memory ring."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from pathlib import Path
from threading import Event

import numpy as np

from palpate_edge.capture.frame_ring import RingFormat, RingWriter
from palpate_edge.common.local_clock import monotonic_us
from palpate_twin.camera.frame_truth import FrameTruth, FrameTruthFile
from palpate_twin.camera.random_presses import moving_press
from palpate_twin.camera.renderer import CameraView
from palpate_twin.dome.probe import Probe


def run_camera(
    view: CameraView,
    path: Path,
    probes: tuple[Probe, ...],
    seed: int,
    stop: Event,
    *,
    seconds: float | None = None,
    truth: Path | None = None,
    after_frame: Callable[[int, int], None] = lambda _written, _skipped: None,
) -> None:
    """Write frames at the sensor's rate until `stop` is set, or for `seconds`.

    An exposure that is late is skipped, which shows as a gap in the sequence numbers. truth: CSV file of the
    true contacts. after_frame: called with the numbers of frames written and skipped. Raises CaptureError if
    the ring cannot be created, ConfigError if the truth cannot be written.
    """
    camera = view.twin.sensor.camera
    form = RingFormat(camera.width, camera.height, 3, fingerprint=view.twin.sensor.fingerprint())
    rng = np.random.default_rng([seed, 8])
    radius_mm = view.twin.sensor.dome.outer_radius_mm
    period_us = 1e6 / camera.fps
    with ExitStack() as stack:
        truths = None if truth is None else stack.enter_context(FrameTruthFile(truth))
        ring = stack.enter_context(closing(RingWriter(path, form)))
        start_us = monotonic_us()
        sequence = written = 0
        while seconds is None or sequence * period_us < 1e6 * seconds:
            exposed_at_us = start_us + round(sequence * period_us)
            if stop.wait(max(0.0, exposed_at_us / 1e6 - time.monotonic())):
                break
            press = moving_press(view.dome, probes, sequence / camera.fps, seed)
            image, force_N = view.frame(press, rng)
            ring.write(image, sequence, exposed_at_us)
            if truths is not None:
                point_mm = None if press is None else radius_mm * press.outward
                truths.write(FrameTruth(sequence, exposed_at_us, point_mm, force_N))
            written += 1
            sequence = max(sequence + 1, int((monotonic_us() - start_us) / period_us))
            after_frame(written, sequence - written)
