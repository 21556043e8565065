"""Local warp: each bead's displacement as its neighbours predict it, by an affine map about every bead.

Skin stretches smoothly, so near one bead the displacement is a plane: a shift and a gradient. Both are fitted
to the neighbours with Gaussian weights, without the bead itself. All sums of all beads are one product of a
matrix (12, n) and a constant one (n, n). Where all beads are known the whole fit is a constant matrix (n, n).
"""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array, Floats, Mask, median
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
        self._unit_px = median(self.spacing_px)
        relative = distance_px / self.spacing_px[:, None]
        weight = np.where(relative < REACH, np.exp(-0.5 * (np.minimum(relative, REACH) / LENGTH) ** 2), 0.0)
        self._weight: Floats = np.ascontiguousarray(weight.T, dtype=np.float32)
        self._per_all = (1.0 / np.maximum(weight.sum(axis=1), 1e-6)).astype(np.float32)
        x, y = ((place - place.mean(axis=0)) / self._unit_px).T.astype(np.float32)
        self._x, self._y = x, y
        self._terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])
        total, x_mean, y_mean, along_x, along_y = self._affine(self._terms @ self._weight)
        relative_x, relative_y = x[:, None] - x_mean, y[:, None] - y_mean
        of_all = self._weight / total * (1.0 + along_x * relative_x + along_y * relative_y)
        self._of_all: Floats = np.ascontiguousarray(of_all.T)

    def predict(self, displacement_px: Array, known: Mask) -> tuple[Array, Array]:
        """Return the displacement (n, 2) of each bead as the `known` (n,) others predict it, and the support.

        Support (n,), 0 to 1: weight of the known neighbours, of all neighbours. A bead without support is
        given displacement 0.
        """
        if known.all():
            predicted = self._of_all @ displacement_px.astype(np.float32)
            return predicted.astype(np.float64), np.ones(len(known))
        values = np.empty((12, len(known)), np.float32)
        np.multiply(self._terms, known, out=values[:6])
        np.multiply(displacement_px.T, known, out=values[6:8], casting="same_kind")
        np.multiply(values[6:8], self._x, out=values[8:10])
        np.multiply(values[6:8], self._y, out=values[10:])
        sums = values @ self._weight
        total, x, y, along_x, along_y = self._affine(sums[:6])
        sums[6:] /= total
        shift = sums[6:8]
        shift_x = (sums[8:10] - shift * x) * along_x
        shift += (sums[10:] - shift * y) * along_y
        shift += shift_x
        return shift.T.astype(np.float64), total * self._per_all

    def _affine(self, sums: Floats) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Return (n,) each: total weight, mean place in x and y, and the factors of the displacement's
        moments about that place in x and in y.

        sums (6, n): of the weighted terms.
        """
        total = np.maximum(sums[0], 1e-6)
        x, y, xx, xy, yy = sums[1:] / total
        xx = xx - x * x + GRADIENT_RIDGE
        xy = xy - x * y
        yy = yy - y * y + GRADIENT_RIDGE
        ahead_x, ahead_y = self._x - x, self._y - y
        per_determinant = 1.0 / (xx * yy - xy * xy)
        along_x = (ahead_x * yy - ahead_y * xy) * per_determinant
        along_y = (ahead_y * xx - ahead_x * xy) * per_determinant
        return total, x, y, along_x, along_y
