"""Image sensor noise: a large field is generated once, and every frame uses a random part of it."""

from __future__ import annotations

import cv2
import numpy as np

from palpate_edge.common.arrays import Image

SPARE = 256  # additional rows and columns of the field, which give 257^2 different parts
CHROMA = 0.5  # share of the noise that differs between channels; cameras smooth their colours


class NoiseField:
    """Adds Gaussian noise in place, clipped at black and white."""

    def __init__(self, height: int, width: int, deviation_grey: float, seed: int) -> None:
        rng = np.random.default_rng([seed, 4])
        shape = (height + SPARE, width + SPARE)
        grey = rng.standard_normal(shape, dtype=np.float32)[..., None]
        own = rng.standard_normal((*shape, 3), dtype=np.float32)
        field = deviation_grey * (np.float32(np.sqrt(1 - CHROMA**2)) * grey + np.float32(CHROMA) * own)
        # Frames have integer grey levels, so integer noise suffices.
        whole = np.rint(field)
        self._brighter = np.clip(whole, 0, 255).astype(np.uint8)
        self._darker = np.clip(-whole, 0, 255).astype(np.uint8)
        self._height, self._width = height, width

    def add(self, image: Image, rng: np.random.Generator) -> None:
        """Add a random part of the field to the image."""
        row, column = rng.integers(0, SPARE + 1, 2).tolist()
        part = (slice(row, row + self._height), slice(column, column + self._width))
        cv2.add(image, self._brighter[part], image)
        cv2.subtract(image, self._darker[part], image)
