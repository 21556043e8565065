"""Array types: one name for each element type; shapes are in the docstrings of the functions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]
Image = NDArray[np.uint8]
"""A picture: (height, width) grey or (height, width, 3) BGR."""
Plane = NDArray[np.float32] | NDArray[np.uint8]
"""One channel of a picture, (height, width), signed so that beads are dark."""
