"""Brightness, focus and blobs of a picture, as far as they can be judged without a calibration.

Focus is the sharpness of edges: the steepest gradients over the contrast of the picture. It has no absolute
limit; it is largest when the lens is in focus.
"""

from __future__ import annotations

import cv2
import msgspec
import numpy as np

from palpate_edge.common.arrays import Image
from palpate_edge.vision.unknown_layout import SEARCH_HEIGHT, beads_without_layout

SATURATED = 250
STEEPEST_PERCENT = 99.5  # percentile of the gradients that count as edges


class PictureMeasure(msgspec.Struct, frozen=True):
    """Measures of one picture. brightness: mean grey level, 0 to 255; saturated_share: of the pixels, 0 to 1;
    sharpness: of the edges, contrasts a pixel; blobs: that look like beads."""

    brightness: float
    saturated_share: float
    sharpness: float
    blobs: int


def measure_picture(image: Image) -> PictureMeasure:
    """Return the measures of a picture; the search for blobs takes about 100 ms."""
    reduced = image
    if image.shape[0] > SEARCH_HEIGHT:
        width = max(1, round(image.shape[1] * SEARCH_HEIGHT / image.shape[0]))
        reduced = np.asarray(
            cv2.resize(image, (width, SEARCH_HEIGHT), interpolation=cv2.INTER_AREA), np.uint8
        )
    brightest = image if image.ndim == 2 else image.max(axis=2)
    return PictureMeasure(
        brightness=float(image.mean()),
        saturated_share=float((brightest >= SATURATED).mean()),
        sharpness=sharpness(image),
        blobs=len(beads_without_layout(reduced)[0].position_px),
    )


def sharpness(image: Image) -> float:
    """Return the steepness of the strongest edges, in contrasts a pixel; 0 for an even picture."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    across, down = (cv2.Sobel(grey, cv2.CV_32F, dx, 1 - dx, ksize=3, scale=1 / 8) for dx in (1, 0))
    low, high = np.percentile(grey, (2, 98))
    if high <= low:
        return 0.0
    return float(np.percentile(cv2.magnitude(across, down), STEEPEST_PERCENT) / (high - low))
