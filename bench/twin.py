"""Processor time per frame of the twin's camera, compared with encoding the frame as JPEG."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.timing import Item, Row, table, time_each
from palpate_twin.camera.random_presses import random_press
from palpate_twin.camera.random_sensor import random_sensor
from palpate_twin.camera.renderer import CameraView
from palpate_twin.dome.library import load_library
from palpate_twin.dome.probe import Probe

SENSORS = {"85 beads, pinhole": 0, "85 beads, fisheye": 2, "127 pins": 3, "331 pins": 4}  # seeds
PRESSES = 60
JPEG_QUALITY = 90


def report() -> str:
    """Return the table."""
    return table("The twin's camera, 640x480 in colour, processor time", rows())


def rows() -> list[Row]:
    """Return all rows in processor time; the first one is the reference for the ratios."""
    library = load_library()
    found: list[Row] = []
    for name, seed in SENSORS.items():
        view = CameraView(random_sensor(seed), library)
        rng = np.random.default_rng(0)
        presses = [random_press(view.dome, (Probe.PLATE, Probe.SPHERE5), rng) for _ in range(PRESSES)]
        if not found:
            images = [view.frame(press, rng)[0] for press in presses]
            found.append(Row("JPEG encoding of such a frame", _times(encode, images)))
            found.append(Row("field of a press, 85 beads and skin", _times(view.dome.press, presses)))
        frames = _times(partial(view.frame, rng=rng), presses)
        found.append(Row(f"frame and force, {name}", frames))
    return found


def encode(image: NDArray[np.uint8]) -> object:
    return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])


def _times(call: Callable[[Item], object], items: Sequence[Item]) -> np.ndarray:
    return time_each(call, items, time.thread_time)
