"""The contact whose field fits the measured places of the beads best, weighted by their noise.

The correction model does not use the noise of single beads. From its answer on, Gauss-Newton steps
minimise, over the place d, the way of the force and the size of the field (five numbers u),

    sum over beads of |y_i - f_i(u)|^2 / (q_i^2 + MODEL_ERROR^2 s^2) + sum of (u_k / sigma_k)^2

with y_i the displacement of bead i, f_i that of the contact fields, q_i the standard deviation of its
measured place, s^2 the frame's own mean square displacement an axis, less the noise, and sigma_k that of the
correction model's answer. A hidden bead counts for nothing.

What the fitted contact's own field leaves of the frame's is the *misfit*, squared, both fields of size 1.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate_edge.common.contact import Vector3
from palpate_edge.estimation.contact_fit.contact_fields import (
    FORCE_WEIGHT,
    PLACE_WEIGHT,
    SIZE_WEIGHT,
    ContactFields,
)
from palpate_edge.estimation.displacement_field import CanonicalField, DisplacementReader, kernel_weights
from palpate_edge.kernels.contact_fit import ContactFitKernel, FitExpansion, FitSettings
from palpate_edge.vision.beads import Beads

STEPS = 2
MODEL_ERROR = 0.15  # of the contact fields, over the frame's displacement
LEAST_SIGNAL = 0.1  # of a frame's mean square displacement; the rest is noise at most
PLACE_SIGMA_RAD = 0.008  # of the correction model's place for a firm contact; times the faintness
WAY_SIGMA_RAD, SIZE_SIGMA = 0.1, 0.5  # of the force's way, of the logarithm of the size
LEAST_FORCE_N, LEAST_SIZE_MM = (
    1e-6,
    1e-6,
)  # below, a force points at the dome's centre, and a field has this size
LARGEST_TURN_RAD = 0.35  # in a step, of place and way together
LARGEST_GROWTH = 0.7  # in a step, of the logarithm of the size


class FitStart(NamedTuple):
    """The correction model's answer for one frame.

    direction: unit vector of the place, force_N: both in F; field: that was corrected; faintness: see
    skin_motion.faintness.
    """

    direction: Vector3
    force_N: Vector3
    field: CanonicalField
    faintness: float


class FittedContact(NamedTuple):
    """direction: unit vector of the place in F; misfit: of the fitted contact, 0 to 4."""

    direction: Vector3
    misfit: float


class ContactFitter:
    """Fits contacts to the displacements of one sensor's beads."""

    def __init__(self, fields: ContactFields, reader: DisplacementReader, noise_px: float) -> None:
        """reader: of the beads' reference; noise_px: standard deviation of an exact bead's place."""
        self.share, self.radius_scale = fields.share, fields.radius_scale
        self._reader = reader
        shapes = fields.shapes.array()
        expansion = FitExpansion(
            fields.centres.array(),
            fields.weights.array(),
            fields.offset.array(),
            shapes,
            kernel_weights(shapes.astype(np.float64)).transpose(0, 2, 1).astype(np.float32),
        )
        settings = FitSettings(
            noise_px2=noise_px**2,
            model_error2=MODEL_ERROR**2,
            least_signal=LEAST_SIGNAL,
            least_force_N=LEAST_FORCE_N,
            least_size_mm=LEAST_SIZE_MM,
            largest_turn_rad=LARGEST_TURN_RAD,
            largest_growth=LARGEST_GROWTH,
            place_weight=PLACE_WEIGHT,
            force_weight=FORCE_WEIGHT,
            size_weight=SIZE_WEIGHT,
        )
        _, mm_per_px = reader.geometry
        px_per_mm = np.linalg.pinv(mm_per_px).astype(np.float32)
        self._kernel = ContactFitKernel(STEPS, settings, expansion, px_per_mm, reader.padded_kernel(0.0))

    def combine(self, beads: Beads, start: FitStart) -> FittedContact:
        """Return the contact at the place between the correction model's and the fitted one."""
        fitted, misfit = self.fit(beads, start)
        x, y, z = (
            given + self.share * (best - given) for given, best in zip(start.direction, fitted, strict=True)
        )
        length = math.hypot(x, y, z)
        return FittedContact((x / length, y / length, z / length), misfit)

    def fit(self, beads: Beads, start: FitStart) -> FittedContact:
        """Return the fitted contact."""
        field, arrays = start.field, self._kernel
        self._reader.padded_kernel(field.azimuth_rad)  # the fit reads it there
        size_mm = max(math.sqrt(float(field.values @ field.values)), LEAST_SIZE_MM)
        azimuth = math.cos(field.azimuth_rad), math.sin(field.azimuth_rad)
        place, way = (PLACE_SIGMA_RAD * start.faintness) ** -2.0, WAY_SIGMA_RAD**-2.0
        sizes = size_mm, math.log(size_mm), beads.found_count
        precision = place, place, way, way, SIZE_SIGMA**-2.0
        arrays.start[:] = *start.direction, *start.force_N, *azimuth, *sizes, *precision
        np.copyto(arrays.values, field.values)
        np.copyto(arrays.measured_px, self._reader.displacement_px(beads))
        np.copyto(arrays.bead_weight, beads.weight)
        x, y, z, misfit = arrays.fit()
        return FittedContact((x, y, z), misfit)
