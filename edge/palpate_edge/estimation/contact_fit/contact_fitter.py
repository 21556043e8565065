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

from palpate_edge.common.arrays import Array, Floats
from palpate_edge.common.contact import Vector3
from palpate_edge.estimation.contact_fit.contact_fields import (
    FORCE_WEIGHT,
    PLACE_WEIGHT,
    SIZE_WEIGHT,
    ContactFields,
)
from palpate_edge.estimation.displacement_field import CanonicalField, DisplacementReader, kernel_weights
from palpate_edge.geometry.angles import rotation_about_z
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
        self._noise_px2 = noise_px**2
        self._centres = fields.centres.array()
        self._weights = np.ascontiguousarray(fields.weights.array().T)
        self._offset = fields.offset.array()
        self._fields = fields.shapes.array()
        # (3 g, p + 1): from the shapes' coefficients to the weights of the kernels.
        skin = kernel_weights(self._fields.astype(np.float64))
        self._skin = np.ascontiguousarray(skin.reshape(len(skin), -1).T, dtype=np.float32)
        _, mm_per_px = reader.geometry
        self._px_per_mm = np.linalg.pinv(mm_per_px).astype(np.float32)

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
        turn = rotation_about_z(start.field.azimuth_rad)
        interpolate = self._reader.canonical_kernel(start.field.azimuth_rad).T  # (n, g)
        to_px = self._px_per_mm @ turn.astype(np.float32)
        measured = self._reader.displacement_px(beads)
        weight = self._bead_weights(measured, beads)
        place, way = turn.T @ start.direction, turn.T @ start.force_N
        force_N = math.sqrt(float(way @ way))
        way = way / force_N if force_N > LEAST_FORCE_N else -place
        size_mm = math.sqrt(float(start.field.values @ start.field.values))
        log_size = math.log(max(size_mm, LEAST_SIZE_MM))
        precision = _precision(start.faintness)
        moved = np.zeros(5)
        for _ in range(STEPS):
            tangents = np.array([*_tangents(place), *_tangents(way)])
            coefficients = self._shapes(place, way, log_size, tangents)
            skin = (self._skin @ coefficients).reshape(interpolate.shape[1], -1)
            seen = (to_px @ (interpolate @ skin).reshape(len(to_px), 3, -1)).reshape(-1, 6)
            displaced = math.exp(log_size) * seen.astype(np.float64)
            slope = displaced[:, 1:]
            weighted = slope.T * weight
            normal = weighted @ slope
            normal.ravel()[:: len(normal) + 1] += precision
            away = weighted @ (measured.ravel() - displaced[:, 0]) - precision * moved
            step = np.linalg.solve(normal, away)
            step *= min(1.0, LARGEST_TURN_RAD / max(math.sqrt(float(step[:4] @ step[:4])), 1e-12))
            step[4] = min(max(step[4], -LARGEST_GROWTH), LARGEST_GROWTH)
            moved += step
            turned = _unit(place + step[:2] @ tangents[:2])
            way = _unit(way + place - turned + step[2:4] @ tangents[2:])
            place, log_size = turned, log_size + float(step[4])
        x, y, z = (turn @ place).tolist()
        return FittedContact((x, y, z), self._misfit(place, way, log_size, start.field))

    def _shapes(self, place: Array, way: Array, log_size: float, tangents: Array) -> Floats:
        """Return the shapes' coefficients (p + 1, 6) of a contact, and their slopes along the five numbers.

        tangents (4, 3): of place and way.
        """
        ways = np.zeros((7, 5), np.float32)
        ways[:3, :2] = PLACE_WEIGHT * tangents[:2].T  # way + place stays as it is
        ways[3:6, 2:4] = FORCE_WEIGHT * tangents[2:].T
        ways[6, 4] = SIZE_WEIGHT
        off, kernels = self._kernels(place, way, log_size)
        both = np.empty((len(off), 6), np.float32)
        both[:, 0] = kernels
        both[:, 1:] = off @ ways
        both[:, 1:] *= kernels[:, None]
        coefficients = np.zeros((len(self._offset) + 1, 6), np.float32)
        coefficients[:-1] = self._weights @ both
        coefficients[:-1, 0] += self._offset
        coefficients[-1, 0] = 1.0
        coefficients[:, 5] += coefficients[:, 0]  # a field grows with its size
        return coefficients

    def _misfit(self, place: Array, way: Array, log_size: float, field: CanonicalField) -> float:
        """Return what the contact's field leaves of the frame's, squared, both of size 1."""
        _, kernels = self._kernels(place, way, log_size)
        expected = (self._weights @ kernels + self._offset) @ self._fields[:-1] + self._fields[-1]
        product = float(expected @ field.values)
        squares = float(expected @ expected) * float(field.values @ field.values)
        return 2.0 - 2.0 * product / math.sqrt(max(squares, LEAST_SIZE_MM**4))

    def _kernels(self, place: Array, way: Array, log_size: float) -> tuple[Floats, Floats]:
        """Return the centres' distances (c, 7) from a contact, and their kernels (c,)."""
        point = np.empty(7, np.float32)
        point[:3], point[3:6] = PLACE_WEIGHT * place, FORCE_WEIGHT * (way + place)
        point[6] = SIZE_WEIGHT * log_size
        off = self._centres - point
        return off, np.exp(-0.5 * np.vecdot(off, off))

    def _bead_weights(self, displacement_px: Array, beads: Beads) -> Array:
        """Return the weight (2 n,) of each bead's x and y, 1/px^2."""
        weight = beads.weight
        total = max(float(weight.sum()), 1e-12)
        square = 0.5 * float(np.vecdot(displacement_px, displacement_px) @ weight) / total
        signal = max(square - self._noise_px2 * beads.found_count / total, LEAST_SIGNAL * square, 1e-12)
        return np.repeat(weight / (self._noise_px2 + MODEL_ERROR**2 * signal * weight), 2)


def _precision(faintness: float) -> Array:
    place = PLACE_SIGMA_RAD * faintness
    return np.array([place, place, WAY_SIGMA_RAD, WAY_SIGMA_RAD, SIZE_SIGMA]) ** -2.0


def _unit(vector: Array) -> Array:
    return np.asarray(vector / math.sqrt(float(vector @ vector)))


def _tangents(direction: Array) -> tuple[Vector3, Vector3]:
    """Return two orthonormal vectors across a unit vector (3,)."""
    x, y, z = direction.tolist()
    if abs(y) < 0.9:
        length = math.hypot(x, z)
        ux, uy, uz = z / length, 0.0, -x / length
    else:
        length = math.hypot(y, z)
        ux, uy, uz = 0.0, -z / length, y / length
    return (ux, uy, uz), (y * uz - z * uy, z * ux - x * uz, x * uy - y * ux)
