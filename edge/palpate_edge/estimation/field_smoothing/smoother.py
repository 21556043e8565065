"""The likeliest displacement of the beads, given their measured places and the typical fields of contacts.

The displacement y (2 n,) of a frame has the normal distribution N(0, s^2 (B L B' + r I)): B the typical
fields, L the variances of their coefficients, r the remainder, s^2 the frame's own mean square displacement
an axis, less the noise. With q_i the standard deviation of a bead's measured place, v_i = NOISE_WEIGHT
(q_i / s)^2 and W = diag(1 / (v_i + r)):

    x = (B' W B + L^-1)^-1 B' W y,    likeliest displacement = B x + r W (y - B x).

A firm contact on clear beads is kept as it is (v << r); of a faint one only the typical fields remain. A
hidden bead has W = 0: its displacement is that of the typical fields. (Rasmussen and Williams, Gaussian
Processes for Machine Learning, 2006, eq. 2.25, in the form of eq. 2.11 for k functions.)
"""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.estimation.field_smoothing.typical_fields import TypicalFields
from palpate_edge.kernels.smoothing import SmoothingKernel
from palpate_edge.vision.beads import Beads

NOISE_WEIGHT = 2.0  # of a bead's variance: errors of neighbouring beads are not independent
LEAST_SIGNAL = 0.1  # of a frame's mean square displacement; the rest is noise at most


class FieldSmoother:
    """Smooths the displacements of one sensor's beads."""

    def __init__(self, typical: TypicalFields, noise_px: float) -> None:
        """noise_px: standard deviation of an exact bead's place along an axis."""
        self._kernel = SmoothingKernel(
            typical.fields.array().astype(np.float64),
            typical.variance.array().astype(np.float64),
            noise_px2=noise_px**2,
            noise_weight=NOISE_WEIGHT,
            remainder=typical.remainder,
            least_signal=LEAST_SIGNAL,
        )

    def smooth(self, displacement_px: Array, beads: Beads) -> Array:
        """Return the likeliest displacement (n, 2) of all beads, 0 where none counts; displacement_px (n, 2):
        as measured."""
        return self._kernel.smooth(
            displacement_px, beads.weight, beads.found_count, all_exact=beads.all_exact
        )
