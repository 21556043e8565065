"""The image sensor's noise: a large field made once, of which every frame takes a part at random."""

from __future__ import annotations

import cv2
import numpy as np

from palpate_edge.common.arrays import Image

SPARE = 256  # rows and columns more than a frame has: 257^2 parts
CHROMA = 0.5  # share of the noise that is each channel's own; cameras smooth their colours


class NoiseField:
    """Adds Gaussian noise in place, clipped at black and white."""

    def __init__(self, height: int, width: int, deviation_grey: float, seed: int) -> None:
        rng = np.random.default_rng([seed, 4])
        shape = (height + SPARE, width + SPARE)
        grey = rng.standard_normal(shape, dtype=np.float32)[..., None]
        own = rng.standard_normal((*shape, 3), dtype=np.float32)
        field = deviation_grey * (np.float32(np.sqrt(1 - CHROMA**2)) * grey + np.float32(CHROMA) * own)
        # The rounding of a frame whose parts are whole grey levels is random already.
        whole = np.rint(field)
        self._brighter = np.clip(whole, 0, 255).astype(np.uint8)
        self._darker = np.clip(-whole, 0, 255).astype(np.uint8)
        self._height, self._width = height, width

    def add(self, image: Image, rng: np.random.Generator) -> None:
        row, column = rng.integers(0, SPARE + 1, 2).tolist()
        part = (slice(row, row + self._height), slice(column, column + self._width))
        cv2.add(image, self._brighter[part], image)
        cv2.subtract(image, self._darker[part], image)
