"""Pictures for people: beads found in one image, layout residuals of a calibration, markers followed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate_edge.drawing import GREEN, RED, YELLOW, Panel, rainbow
from palpate_edge.follow_video import Followed
from palpate_edge.markers import Image

Array = NDArray[np.float64]

SHEET_WIDTH = 1280  # of a single picture, pixels
RESIDUAL_SCALE = 20


def draw_beads(image: Image, position_px: Array, diameter_px: float) -> Image:
    """The image, twice as large, with a numbered circle about each bead."""
    panel = Panel(image, 2.0)
    for number, place in enumerate(position_px):
        panel.circle(place, diameter_px / 2, GREEN)
        panel.text(place, str(number), YELLOW)
    return panel.canvas


def draw_followed(followed: Followed) -> Image:
    """Where each marker went: the way forth as a line, a circle where it began (red if it did not come back),
    its number and the share of frames in which it was found."""
    panel = Panel(followed.first, SHEET_WIDTH / followed.first.shape[1], dim=0.75)
    found = followed.forth_found.mean(axis=0)
    home = followed.home
    for number, start in enumerate(followed.start_px):
        panel.lines(followed.forth_px[:, number], rainbow(number * 0.382 % 1.0))
        panel.circle(start, 3.0, GREEN if home[number] else RED, 2)
        panel.text(start + np.array([4.0, -1.0]), f"{number} {100 * found[number]:.0f}%", YELLOW, 0.45)
    return panel.titled(
        f"{len(followed.lost)} frames, {len(home)} markers: {int(home.sum())} came back, "
        f"{int(followed.swapped.sum())} swapped",
        f"markers lost a frame {followed.lost.mean():.2f} (most {followed.lost.max()}); both ways agree in "
        f"{100 * followed.agreement:.2f} % of places; lines: way forth, %: frames in which it was found",
    )
