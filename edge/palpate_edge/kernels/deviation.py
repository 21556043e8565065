"""Deviation of the pixels of an image, in deviation.c."""

from __future__ import annotations

import ctypes
import math

from palpate_edge.kernels.library import kernel

UNITS = 256.0
"""Units of the kernel's variance in one squared grey level."""


class DeviationKernel:
    """Computes how much pixels deviate from their mean."""

    def __init__(self) -> None:
        self._variance = kernel("largest_variance", ctypes.c_char_p, ctypes.c_int32, ctypes.c_int32)

    def largest(self, pixels: bytes, channels: int) -> float:
        """Return the largest standard deviation of a channel, in grey levels to a sixteenth.

        pixels: one behind the other, each with a byte for each of its channels.
        """
        return math.sqrt(self._variance(pixels, len(pixels) // channels, channels) / UNITS)
