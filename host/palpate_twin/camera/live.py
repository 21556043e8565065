"""A simulated fingertip's camera in real time: a moving contact, rendered into a ring of frames."""

from __future__ import annotations

import csv
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from pathlib import Path
from threading import Event

import numpy as np

from palpate_edge.capture.frame_ring import RingFormat, RingWriter
from palpate_edge.common.errors import ConfigError
from palpate_edge.common.local_clock import monotonic_us
from palpate_twin.camera.random_presses import moving_press
from palpate_twin.camera.renderer import CameraView
from palpate_twin.dome.probe import Probe

COLUMNS = ["sequence", "exposed_at_us", "x_mm", "y_mm", "z_mm", "fx_N", "fy_N", "fz_N"]


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
    """Write frames at the sensor's rate until `stop`, or for so long; truth: a CSV of what pressed.

    An exposure whose turn has passed is skipped: its sequence number shows it. Raises CaptureError where the
    ring cannot be made, ConfigError for the truth.
    """
    camera = view.twin.sensor.camera
    form = RingFormat(camera.width, camera.height, 3, fingerprint=view.twin.sensor.fingerprint())
    rng = np.random.default_rng([seed, 8])
    radius_mm = view.twin.sensor.dome.outer_radius_mm
    period_us = 1e6 / camera.fps
    with ExitStack() as stack:
        note = _open_truth(truth, stack)
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
            place = ["", "", ""] if press is None else [f"{v:.4f}" for v in radius_mm * press.outward]
            note([str(sequence), str(exposed_at_us), *place, *(f"{v:.5f}" for v in force_N)])
            written += 1
            sequence = max(sequence + 1, int((monotonic_us() - start_us) / period_us))
            after_frame(written, sequence - written)


def _open_truth(path: Path | None, stack: ExitStack) -> Callable[[list[str]], object]:
    """Takes a row each time it is called."""
    if path is None:
        return lambda _row: None
    try:
        file = stack.enter_context(path.open("w", newline="", encoding="utf-8", buffering=1))
    except OSError as error:
        raise ConfigError(f"{path} cannot be written: {error.strerror}: give another --truth") from None
    rows = csv.writer(file, lineterminator="\n")
    rows.writerow(COLUMNS)
    return rows.writerow
