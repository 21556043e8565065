"""A picture to draw on in the pixels of the camera's image, with a title; panels side by side as one sheet.

OpenCV only, so that a fingertip's board can do it. Places may lie between pixels.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.arrays import Array, Image

Colour = tuple[int, int, int]  # blue, green, red

GREEN, YELLOW, RED = (80, 220, 60), (0, 220, 255), (60, 60, 240)
CYAN, WHITE, GREY, BLACK = (230, 200, 40), (255, 255, 255), (150, 150, 150), (24, 22, 20)
FONT = cv2.FONT_HERSHEY_SIMPLEX
SHIFT = 4  # OpenCV draws in 16ths of a pixel
TITLE_HEIGHT = 54
GAP = 8


class Panel:
    """One picture. `canvas` is what was drawn so far, (height, width, 3) BGR."""

    def __init__(
        self, image: Image, scale: float, dim: float = 1.0, about_px: Array | None = None, zoom: float = 1.0
    ) -> None:
        """image: grey or BGR, enlarged `scale` times and darkened to `dim` of its brightness; of a picture of
        the same size only the part about `about_px`, `zoom` times as large, when that is given."""
        size = round(image.shape[1] * scale), round(image.shape[0] * scale)
        self._scale, self._origin = scale, np.zeros(2)
        if about_px is not None:
            self._scale = scale * zoom
            height, width = (round(side / zoom) for side in image.shape[:2])
            limit = np.array([image.shape[1] - width, image.shape[0] - height])
            self._origin = np.clip(np.rint(about_px - np.array([width, height]) / 2), 0, limit)
            left, top = (int(value) for value in self._origin)
            image = image[top : top + height, left : left + width]
        colour = image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
        large = cv2.resize(colour, size, interpolation=cv2.INTER_CUBIC)
        self.canvas: Image = np.asarray(cv2.convertScaleAbs(large, alpha=dim), dtype=np.uint8)

    def _at(self, places_px: Array) -> NDArray[np.int32]:
        """(..., 2) image pixels -> 16ths of a pixel of the canvas."""
        on_canvas = (np.asarray(places_px) - self._origin + 0.5) * self._scale - 0.5
        return np.asarray(np.rint(on_canvas * (1 << SHIFT)), dtype=np.int32)

    def circle(self, at_px: Array, radius_px: float, colour: Colour, thickness: int = 1) -> None:
        """thickness -1 fills."""
        x, y = self._at(at_px).tolist()
        radius = max(1, round(radius_px * self._scale * (1 << SHIFT)))
        cv2.circle(self.canvas, (x, y), radius, colour, thickness, cv2.LINE_AA, SHIFT)

    def lines(self, places_px: Array, colour: Colour, thickness: int = 1, *, closed: bool = False) -> None:
        """Through (n, 2) places."""
        cv2.polylines(self.canvas, [self._at(places_px)], closed, colour, thickness, cv2.LINE_AA, SHIFT)

    def fill(self, corners_px: Array, colour: Colour) -> None:
        cv2.fillConvexPoly(self.canvas, self._at(corners_px), colour, cv2.LINE_AA, SHIFT)

    def arrow(self, from_px: Array, to_px: Array, colour: Colour) -> None:
        start, end = self._at(from_px).tolist(), self._at(to_px).tolist()
        cv2.arrowedLine(self.canvas, start, end, colour, 1, cv2.LINE_AA, SHIFT, 0.25)

    def cross(self, at_px: Array, colour: Colour, size_px: float = 5.0, thickness: int = 2) -> None:
        x, y = np.asarray(at_px)
        for sign in (1, -1):
            ends = np.array([(x - size_px, y - sign * size_px), (x + size_px, y + sign * size_px)])
            self.lines(ends, colour, thickness)

    def text(self, at_px: Array, text: str, colour: Colour, size: float = 0.36) -> None:
        """Text with a dark outline, its lower left corner at a place of the image."""
        x, y = (self._at(at_px) >> SHIFT).tolist()
        cv2.putText(self.canvas, text, (x, y), FONT, size, BLACK, 3, cv2.LINE_AA)
        cv2.putText(self.canvas, text, (x, y), FONT, size, colour, 1, cv2.LINE_AA)

    def titled(self, title: str, note: str = "") -> Image:
        """The canvas under a title and a line of figures."""
        bar = np.full((TITLE_HEIGHT, self.canvas.shape[1], 3), BLACK, dtype=np.uint8)
        cv2.putText(bar, title, (8, 21), FONT, 0.58, WHITE, 1, cv2.LINE_AA)
        cv2.putText(bar, note, (8, 44), FONT, 0.46, YELLOW, 1, cv2.LINE_AA)
        return np.concatenate([bar, self.canvas])


def sheet(panels: Sequence[Image], columns: int) -> Image:
    """Titled panels of one size, row by row; what is left of the last row stays dark."""
    height, width = panels[0].shape[:2]
    rows = -(-len(panels) // columns)
    shape = (rows * (height + GAP) + GAP, columns * (width + GAP) + GAP, 3)
    page = np.full(shape, BLACK, dtype=np.uint8)
    for number, panel in enumerate(panels):
        top = GAP + number // columns * (height + GAP)
        left = GAP + number % columns * (width + GAP)
        page[top : top + height, left : left + width] = panel
    return page


def diverging(value: float) -> Colour:
    """Blue at -1, grey at 0, red at 1."""
    share = min(1.0, abs(value))
    end = (60, 60, 230) if value > 0 else (230, 120, 40)
    blue, green, red = (round((1 - share) * 90 + share * channel) for channel in end)
    return blue, green, red


def rainbow(share: float) -> Colour:
    """A clear colour for each share of a round, 0 to 1."""
    hue = np.array([[[round(179 * share), 200, 255]]], dtype=np.uint8)
    blue, green, red = (int(channel) for channel in cv2.cvtColor(hue, cv2.COLOR_HSV2BGR)[0, 0])
    return blue, green, red
