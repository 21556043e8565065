"""An exposure time proposed from a picture: bright, and nothing saturated; pure."""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Image

BRIGHTEST_PERCENT = 99.5  # percentile of the pixels that counts as the brightest
TARGET = 200.0  # of 255, for the brightest pixels
SATURATED = 250.0
TOLERANCE = 0.1
PERIOD_SHARE = 0.8  # of the frame period, at most
STEP_US = 100  # of V4L2's control


def propose_exposure_us(image: Image, exposure_us: int, fps: float) -> int:
    """Return the exposure time that brings the brightest pixels of a picture to `TARGET`.

    exposure_us: that of the picture, which is returned when it is right within `TOLERANCE`. A saturated
    picture does not show by how much it is too bright, so its exposure is halved: measure and propose again.
    """
    brightest = image if image.ndim == 2 else image.max(axis=2)
    level = float(np.percentile(brightest, BRIGHTEST_PERCENT))
    longest_us = int(PERIOD_SHARE * 1e6 / fps) // STEP_US * STEP_US
    factor = 0.5 if level >= SATURATED else min(8.0, TARGET / max(level, 1.0))
    if abs(factor - 1) <= TOLERANCE and exposure_us <= longest_us:
        return exposure_us
    return min(max(STEP_US, round(factor * exposure_us / STEP_US) * STEP_US), longest_us)
