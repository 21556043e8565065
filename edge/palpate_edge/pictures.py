"""Pictures for people."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from palpate_edge.markers import Image

GREEN, YELLOW = (80, 220, 60), (0, 220, 255)


def draw_beads(image: Image, position_px: NDArray[np.float64], diameter_px: float) -> Image:
    """The image, twice as large, with a numbered circle about each bead."""
    colour = image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    picture = cv2.resize(colour, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    for number, (x, y) in enumerate(position_px):
        centre = (round(2 * x + 0.5), round(2 * y + 0.5))
        cv2.circle(picture, centre, max(3, round(diameter_px)), GREEN, 1, cv2.LINE_AA)
        cv2.putText(picture, str(number), centre, cv2.FONT_HERSHEY_SIMPLEX, 0.35, YELLOW, 1, cv2.LINE_AA)
    return np.asarray(picture, dtype=np.uint8)
