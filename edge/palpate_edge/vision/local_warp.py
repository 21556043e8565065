"""Local warp: each bead's displacement as its neighbours predict it, by an affine map about every bead.

Skin stretches smoothly, so near one bead the displacement is a plane: a shift and a gradient. Both are fitted
to the neighbours with Gaussian weights, without the bead itself. All sums of all beads are one product of a
constant matrix (n, n) and a matrix (n, 12).
"""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array, Mask
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
        self._unit_px = float(np.median(self.spacing_px))
        relative = distance_px / self.spacing_px[:, None]
        weight = np.where(relative < REACH, np.exp(-0.5 * (np.minimum(relative, REACH) / LENGTH) ** 2), 0.0)
        self._weight = weight.astype(np.float32)
        self._all = np.maximum(self._weight.sum(axis=1), 1e-6)
        self._place = ((place - place.mean(axis=0)) / self._unit_px).astype(np.float32)
        x, y = self._place.T
        self._terms = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])

    def predict(self, displacement_px: Array, known: Mask) -> tuple[Array, Array]:
        """Return the displacement (n, 2) of each bead as the `known` (n,) others predict it, and the support.

        Support (n,), 0 to 1: weight of the known neighbours, of all neighbours. A bead without support is
        given displacement 0.
        """
        place = self._place
        value = (displacement_px * (known / self._unit_px)[:, None]).astype(np.float32)
        terms = self._terms * known[:, None]
        sums = self._weight @ np.concatenate(
            [terms, value, value * place[:, :1], value * place[:, 1:]], axis=1
        )
        total = np.maximum(sums[:, 0], 1e-6)
        sums /= total[:, None]
        mean = sums[:, 1:3]
        xx = sums[:, 3] - mean[:, 0] ** 2 + GRADIENT_RIDGE
        xy = sums[:, 4] - mean[:, 0] * mean[:, 1]
        yy = sums[:, 5] - mean[:, 1] ** 2 + GRADIENT_RIDGE
        shift = sums[:, 6:8]
        along_x = sums[:, 8:10] - shift * mean[:, :1]
        along_y = sums[:, 10:12] - shift * mean[:, 1:]
        offset = (place - mean) / (xx * yy - xy * xy)[:, None]
        by_x = offset[:, 0] * yy - offset[:, 1] * xy
        by_y = offset[:, 1] * xx - offset[:, 0] * xy
        predicted = shift + by_x[:, None] * along_x + by_y[:, None] * along_y
        return predicted.astype(np.float64) * self._unit_px, total / self._all
