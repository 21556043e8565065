"""Draw beads into one image plane: the covered fraction of each pixel, exact to a fraction of a per cent."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.arrays import Array

Plane = NDArray[np.uint8]

WHOLE = 200  # value of a fully covered pixel; higher values up to 255 are the highlight
SMOOTHSTEP_SIGMA = 0.2236  # standard deviation of the smoothstep's derivative over its width: sqrt(1/20)
PIXEL_VARIANCE = 1 / 12
HIGHLIGHT_RADIUS = 0.3  # as a fraction of the bead's radius


class BeadLayer:
    """Draws ellipses with smoothstep edges whose width follows from pixel size and lens blur."""

    def __init__(self, width: int, height: int, softness_px: float, highlight: float) -> None:
        self._width, self._height = width, height
        self._edge = np.float32(np.sqrt(PIXEL_VARIANCE + softness_px**2) / SMOOTHSTEP_SIGMA)
        self._highlight = np.float32(highlight * (255 - WHOLE))
        self._bordered = np.zeros((height, width), dtype=np.uint8)

    def draw(self, centre_px: Array, shape: Array) -> Plane:
        """Return the plane (height, width) of outlines centre_px (n, 2), shape (n, 2, 2).

        The result is valid until the next call.
        """
        extent = float(np.sqrt(max(shape[:, 0, 0].max(), shape[:, 1, 1].max()))) if len(shape) else 0.0
        reach = int(np.ceil(extent + 0.5 * self._edge)) + 1
        border, side = 2 * reach, 2 * reach + 1  # beads at the edge are drawn into the border
        bordered = self._with_border(border)
        pixel = np.rint(centre_px).astype(np.intp)
        far = np.array([self._width, self._height]) + reach
        near = ((pixel >= -reach) & (pixel < far)).all(axis=1)
        pixel = pixel[near]
        patches = self._patches(centre_px[near] - pixel, np.asarray(np.linalg.inv(shape[near])), reach)
        for (x, y), patch in zip((pixel + border - reach).tolist(), patches, strict=True):
            target = bordered[y : y + side, x : x + side]
            cv2.max(target, patch, target)
        return bordered[border : border + self._height, border : border + self._width]

    def _with_border(self, border: int) -> Plane:
        """Return the cleared plane with a border of that many pixels."""
        height, width = self._height + 2 * border, self._width + 2 * border
        if self._bordered.shape != (height, width):
            self._bordered = np.empty((height, width), dtype=np.uint8)
        self._bordered[:] = 0
        return self._bordered

    def _patches(self, shift_px: Array, inverse: Array, reach: int) -> NDArray[np.uint8]:
        """Return patches (n, side, side) of ellipses whose centres are shift_px (n, 2) off the middle."""
        span = np.arange(-reach, reach + 1, dtype=np.float32)
        x = span[None, None, :] - shift_px[:, 0, None, None].astype(np.float32)
        y = span[None, :, None] - shift_px[:, 1, None, None].astype(np.float32)
        a, b, c = (inverse[:, i, j, None, None].astype(np.float32) for i, j in ((0, 0), (0, 1), (1, 1)))
        by_x, by_y = a * x + b * y, b * x + c * y
        radius = x * by_x
        radius += y * by_y
        np.sqrt(radius, out=radius)
        radius += np.float32(1e-6)  # 1 on the outline
        slope, step = np.multiply(by_x, by_x, out=by_x), np.multiply(by_y, by_y, out=by_y)
        slope += step
        np.sqrt(slope, out=slope)
        slope += np.float32(1e-9)  # magnitude of the radius's gradient, times the radius
        np.subtract(1, radius, out=step)
        step *= radius
        step /= slope  # inwards, in pixels
        step /= self._edge
        step += np.float32(0.5)
        np.clip(step, 0, 1, out=step)
        covered = np.multiply(step, step, out=slope)
        step *= -2
        step += 3
        covered *= step
        covered *= np.float32(WHOLE)
        if self._highlight:
            radius /= np.float32(-HIGHLIGHT_RADIUS)
            radius += 1
            np.clip(radius, 0, 1, out=radius)
            radius *= self._highlight
            covered += radius
        covered += np.float32(0.5)
        return covered.astype(np.uint8)
