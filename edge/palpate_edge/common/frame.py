"""The value that every capture source gives: one image with the time it was exposed."""

from __future__ import annotations

import msgspec
import numpy as np
from numpy.typing import NDArray


class Frame(msgspec.Struct, frozen=True):
    """One camera frame.

    image: (height, width) grey or (height, width, 3) BGR, uint8.
    exposed_at_us: time of exposure on the clock of the capture source, microseconds.
    sequence: counts every frame that the source exposed, so that a gap is a dropped frame.
    name: where it comes from (file name, ``video#12``), for messages and the CSV.
    """

    image: NDArray[np.uint8]
    exposed_at_us: int
    sequence: int
    name: str
