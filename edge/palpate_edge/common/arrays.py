"""Array types, one name for each element type, and the median.

Shapes are in the docstrings of the functions.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]
Counts = NDArray[np.int32]
Image = NDArray[np.uint8]
"""A picture: (height, width) grey or (height, width, 3) BGR."""
Plane = NDArray[np.float32] | NDArray[np.uint8]
"""One channel of a picture, (height, width), signed so that beads are dark."""


def median(values: Array | Floats) -> float:
    """Return the median of one or more numbers without NaN.

    np.median also checks for masked arrays. It loads numpy.ma for that check: 42 M instructions at the start.
    """
    ordered, half = np.sort(values, axis=None), values.size // 2
    return float(ordered[half] if values.size % 2 else 0.5 * (ordered[half - 1] + ordered[half]))
