"""A trial of the chosen camera: a few pictures, their measures, and an exposure that suits them."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing

import msgspec

from palpate_edge.can_bus.simulated_clock import clock_of
from palpate_edge.common.arrays import Image
from palpate_edge.common.errors import CaptureError
from palpate_edge.daemon.capture_factory import open_source, requested_stream
from palpate_edge.daemon.config import FingertipConfig
from palpate_edge.setup.exposure import propose_exposure_us

SETTLE_FRAMES = 5  # a camera applies a new exposure after some frames
ROUNDS = 5


def try_camera(config: FingertipConfig, report: Callable[[str], None]) -> tuple[Image, int]:
    """Return a picture of the configured camera and its exposure in us, 0 when it is unknown.

    report: takes one line for each setting that differs from the request.
    Raises CaptureError or DatasetError.
    """
    with closing(open_source(config, None, clock_of(config.bus), report)) as source:
        image = None
        for _ in range(SETTLE_FRAMES):
            frame = source.read()
            if frame is None:
                break
            image = frame.image
        if image is None:
            raise CaptureError(f"{config.capture.path} gave no frame: choose another camera")
        return image, source.exposure_us


def suitable_exposure(config: FingertipConfig, report: Callable[[str], None]) -> tuple[Image, int | None]:
    """Return a picture at a suitable exposure, and that exposure; None where the camera has no such control.

    Raises CaptureError or DatasetError.
    """
    image, exposure_us = try_camera(config, report)
    fps = requested_stream(config, None)[2]
    if not exposure_us:
        return image, None
    for _ in range(ROUNDS):
        proposed_us = propose_exposure_us(image, exposure_us, fps)
        if proposed_us == exposure_us:
            break
        camera = msgspec.structs.replace(config.capture.camera, exposure_us=proposed_us)
        capture = msgspec.structs.replace(config.capture, camera=camera)
        exposure_us = proposed_us
        image, _ = try_camera(msgspec.structs.replace(config, capture=capture), lambda _line: None)
    return image, exposure_us
