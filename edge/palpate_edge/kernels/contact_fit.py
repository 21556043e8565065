"""Gauss-Newton steps of a contact to the displacement of the beads, in contact_fit.c."""

from __future__ import annotations

import ctypes
from typing import NamedTuple

import numpy as np

from palpate_edge.common.arrays import Floats
from palpate_edge.kernels.library import POINTER, addresses, kernel
from palpate_edge.kernels.padding import BLOCK, padded_length, padded_rows

COLUMNS = 6
"""A field and its slopes along the five numbers of a contact."""

_COUNTS = (
    "steps",
    "beads",
    "padded_beads",
    "directions",
    "centres",
    "padded_centres",
    "shapes",
    "padded_shapes",
    "padded_skin",
    "padded_fields",
)
_POINTERS = (
    "centre",
    "weights",
    "offset",
    "fields",
    "skin",
    "kernel",
    "px_per_mm",
    "start",
    "values",
    "measured_px",
    "bead_weight",
    "weight",
    "both",
    "coefficients",
    "moved",
    "seen",
    "expected",
    "fitted",
)


class FitSettings(NamedTuple):
    """Constants of contact_fitter.py, in the order of the C struct."""

    noise_px2: float
    model_error2: float
    least_signal: float
    least_force_N: float
    least_size_mm: float
    largest_turn_rad: float
    largest_growth: float
    place_weight: float
    force_weight: float
    size_weight: float


class FitExpansion(NamedTuple):
    """Fields of contacts: centres (c, 7), weights (c, p), offset (p,), shapes (p + 1, 2 g), and the shapes'
    weights (p + 1, 3, g) of the kernels about the g directions."""

    centres: Floats
    weights: Floats
    offset: Floats
    shapes: Floats
    skin: Floats


class _ContactFit(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_int32) for name in _COUNTS),
        *((name, ctypes.c_double) for name in FitSettings._fields),
        *((name, POINTER) for name in _POINTERS),
    ]


class ContactFitKernel:
    """Fits contacts of one sensor; all its arrays are made once.

    start (16,): place (3,) and force (3,) in F, cosine and sine of the canonical frame's azimuth, size of
    the field in mm and its logarithm, count of found beads, precision (5,) of the contact's numbers; values
    (2 g,), mm: of the field; measured_px (n, 2): displacement of the beads; bead_weight (n,): of each bead
    in a mean.
    """

    def __init__(
        self,
        steps: int,
        settings: FitSettings,
        expansion: FitExpansion,
        px_per_mm: Floats,
        covariance: Floats,
    ) -> None:
        """px_per_mm (n, 2, 3): displacement in the image for a millimetre in F; covariance (g, padded n): of
        the canonical directions and the beads, which holds that of the frame's azimuth at each call."""
        (centres, _), (shapes, fields) = expansion.centres.shape, expansion.shapes.shape
        beads, directions = len(px_per_mm), fields // 2
        sizes = (beads, directions, centres, shapes - 1)
        if (
            covariance.shape != (directions, padded_length(beads))
            or expansion.weights.shape != (centres, shapes - 1)
            or expansion.offset.shape != (shapes - 1,)
            or expansion.skin.shape != (shapes, 3, directions)
            or expansion.centres.shape[1] != COLUMNS + 1
        ):
            raise ValueError(f"contact fields do not fit each other or the beads: {sizes}")
        padded_centres, padded_shapes = padded_length(centres), padded_length(shapes - 1)
        padded_skin = padded_length(3 * directions)
        self.start, self.values = np.zeros(16), np.zeros(fields)
        self.measured_px, self.bead_weight = np.zeros((beads, 2)), np.zeros(beads)
        self._fitted = np.zeros(4)
        singles = {
            "centre": padded_rows(expansion.centres.T),
            "weights": padded_rows(expansion.weights),
            "offset": padded_rows(expansion.offset),
            "fields": padded_rows(expansion.shapes),
            "skin": padded_rows(expansion.skin.reshape(shapes, -1)),
            "kernel": covariance,
            "px_per_mm": padded_rows(px_per_mm.transpose(1, 2, 0)),
            "both": np.zeros((COLUMNS, padded_centres), np.float32),
            "coefficients": np.zeros((COLUMNS, padded_shapes + BLOCK), np.float32),
            "moved": np.zeros((COLUMNS, padded_skin), np.float32),
            "seen": np.zeros((3, COLUMNS, padded_length(beads)), np.float32),
            "expected": np.zeros(padded_length(fields), np.float32),
        }
        doubles = {
            "start": self.start,
            "values": self.values,
            "measured_px": self.measured_px,
            "bead_weight": self.bead_weight,
            "weight": np.zeros(beads),
            "fitted": self._fitted,
        }
        self._arrays = singles, doubles
        struct = _ContactFit(
            steps,
            beads,
            padded_length(beads),
            directions,
            centres,
            padded_centres,
            shapes - 1,
            padded_shapes,
            padded_skin,
            padded_length(fields),
            *settings,
            **addresses(singles, np.float32),
            **addresses(doubles, np.float64),
        )
        self._struct = ctypes.byref(struct)
        self._fit = kernel("contact_fit", POINTER)

    def fit(self) -> tuple[float, float, float, float]:
        """Return the unit vector of the fitted place in F and the misfit, for the arrays of this frame."""
        self._fit(self._struct)
        x, y, z, misfit = self._fitted.tolist()
        return x, y, z, misfit
