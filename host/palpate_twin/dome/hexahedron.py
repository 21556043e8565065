"""The 20-node serendipity hexahedron: shape functions and their derivatives in natural coordinates, -1 to 1.

Source: Zienkiewicz and Taylor, The Finite Element Method, volume 1. Nodes are in the order of
`mesh.HEXAHEDRON20`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.arrays import Array
from palpate_twin.dome.mesh import HEXAHEDRON20

# (20, 3) natural coordinates; 0 along the axis of a mid-edge node.
NODES = HEXAHEDRON20.astype(np.float64) - 1.0


def shape(natural: Array) -> Array:
    """Return the shape functions (q, 20) at natural coordinates (q, 3)."""
    corner, middle, factors, reach = _parts(natural)
    values = np.where(corner, 0.125 * (reach.sum(axis=2) - 2.0), 0.25) * factors.prod(axis=2)
    return np.asarray(np.where(corner | middle.any(axis=1), values, 0.0))


def slope(natural: Array) -> Array:
    """Return the derivatives (q, 20, 3) of the shape functions at natural coordinates (q, 3)."""
    corner, middle, factors, reach = _parts(natural)
    by_factor = np.where(middle, -2.0 * natural[:, None, :], NODES)
    gradient = np.empty_like(factors)
    for axis in range(3):
        others = np.delete(factors, axis, axis=2).prod(axis=2)
        along = by_factor[:, :, axis]
        at_corner = 0.125 * others * along * (reach.sum(axis=2) - 2.0 + factors[:, :, axis])
        gradient[:, :, axis] = np.where(corner, at_corner, 0.25 * others * along)
    return gradient


def _parts(natural: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_], Array, Array]:
    """Return the parts of the shape functions.

    corner (20,): corner nodes; middle (20, 3): axis of each mid-edge node; factors (q, 20, 3): 1 + x x_a, or
    1 - x^2 on that axis; reach (q, 20, 3): x x_a.
    """
    middle = NODES == 0
    reach = natural[:, None, :] * NODES
    factors = np.where(middle, 1.0 - natural[:, None, :] ** 2, 1.0 + reach)
    return ~middle.any(axis=1), middle, factors, reach
