"""Local warp: each bead's displacement as its neighbours predict it, by an affine map about every bead.

Skin stretches smoothly, so near one bead the displacement is a plane: a shift and a gradient. Both are fitted
to the neighbours with Gaussian weights, without the bead itself: twelve weighted sums over about twenty
neighbours, computed by kernels/local_warp.c.
"""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array, Mask, median
from palpate_edge.kernels.local_warp import WarpKernel
from palpate_edge.vision.neighbourhood import Neighbourhood

LENGTH, REACH = 1.1, 2.6  # of the weights, in local spacings; neighbours beyond the reach have none
NEAREST = 4  # neighbours whose mean distance is the local spacing
GRADIENT_RIDGE = 0.05  # squared spacings: a few neighbours in a row determine no gradient across it


class LocalWarp:
    """Predicts the displacements of one layout's beads from each other.

    spacing_px (n,): mean distance from each bead to its four nearest neighbours.
    """

    def __init__(self, neighbourhood: Neighbourhood) -> None:
        """neighbourhood: of the reference's beads."""
        place = neighbourhood.position_px
        distance_px = neighbourhood.distance_px.copy()
        np.fill_diagonal(distance_px, np.inf)
        nearest = np.sort(distance_px, axis=1)[:, :NEAREST]
        self.spacing_px: Array = np.mean(nearest, axis=1)
        relative = distance_px / self.spacing_px[:, None]
        weight = np.where(relative < REACH, np.exp(-0.5 * (np.minimum(relative, REACH) / LENGTH) ** 2), 0.0)
        unit_px = median(self.spacing_px)
        self.kernel = WarpKernel((place - place.mean(axis=0)) / unit_px, weight, GRADIENT_RIDGE)

    def predict(self, displacement_px: Array, known: Mask) -> tuple[Array, Array]:
        """Return the displacement (n, 2) of each bead as the `known` (n,) others predict it, and the support.

        Support (n,), 0 to 1: weight of the known neighbours, of all neighbours. A bead without support is
        given displacement 0.
        """
        return self.kernel.predict(displacement_px, known)
