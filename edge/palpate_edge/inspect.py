"""Pictures for people: what the bead finder saw in one image."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from palpate_edge.markers import Appearance, Blobs, Image, find_blobs, plane

GREEN, YELLOW = (80, 220, 60), (0, 220, 255)
SCALES = (0.6, 0.75, 1.0, 1.3, 1.7)
CHANNELS_TRIED = ("grey",)


def beads_without_layout(image: Image, diameter_px: float | None = None) -> tuple[Blobs, Appearance, float]:
    """Beads of an unknown layout: the strongest blobs down to the widest gap in strength.

    Both signs are tried, and bead sizes from 1/60 to 1/20 of the image's height unless `diameter_px` says.
    Gives the beads, how they look and their size in pixels.
    """
    sizes = [diameter_px] if diameter_px else [image.shape[0] / n for n in (60, 50, 42, 35, 30, 25, 20)]
    best: tuple[float, Blobs, Appearance, float] | None = None
    for bright in (False, True):
        appearance = Appearance("grey", bright)
        dark = plane(image, appearance)
        for size in sizes:
            blobs = find_blobs(dark, size)
            count, gap = _widest_gap(blobs.strength)
            score = gap * float(np.median(blobs.strength[:count])) if count else 0.0
            if best is None or score > best[0]:
                kept = Blobs(blobs.position_px[:count], blobs.strength[:count])
                best = (score, kept, appearance, size)
    assert best is not None
    return best[1], best[2], best[3]


def _widest_gap(strength: NDArray[np.float64]) -> tuple[int, float]:
    """How many blobs stand before the widest relative fall of strength, and how wide it is."""
    if len(strength) < 8:
        return 0, 0.0
    ratio = strength[5:-1] / np.maximum(strength[6:], 1e-6)
    place = int(np.argmax(ratio))
    return place + 6, float(ratio[place])


def draw_beads(image: Image, position_px: NDArray[np.float64], diameter_px: float) -> Image:
    """The image, twice as large, with a numbered circle about each bead."""
    colour = image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    picture = cv2.resize(colour, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    for number, (x, y) in enumerate(position_px):
        centre = (round(2 * x + 0.5), round(2 * y + 0.5))
        cv2.circle(picture, centre, max(3, round(diameter_px)), GREEN, 1, cv2.LINE_AA)
        cv2.putText(picture, str(number), centre, cv2.FONT_HERSHEY_SIMPLEX, 0.35, YELLOW, 1, cv2.LINE_AA)
    return np.asarray(picture, dtype=np.uint8)
