"""The canonical displacement field: the correction model's input.

The dome is axisymmetric: a press at one azimuth is the same press at any other, rotated, and the mirror image
of a press is a press. Bead places differ between sensors, and some beads are hidden. Therefore the beads'
displacement is interpolated (Gaussian process, Matern 3/2 kernel on the sphere) and evaluated at fixed
directions of a *canonical frame*: F rotated about z by the azimuth of the displacement's centre of gravity.

A faint contact displaces the beads by little more than the errors of their places. With the typical fields of
the sensor's contacts the displacement is first smoothed (field_smoothing/smoother.py): in all frames of
sensors in hard light, of others where beads are hidden or inexact, whose displacement the typical fields fill
in. Without them the noise of the process is that of the beads over the frame's own displacement: the field of
a firm contact is interpolated, that of a faint one smoothed.
"""

from __future__ import annotations

import math

import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Floats
from palpate_edge.estimation.field_smoothing.smoother import FieldSmoother
from palpate_edge.estimation.field_smoothing.typical_fields import TypicalFields
from palpate_edge.geometry.angles import azimuth, polar_angle, rotation_about_z
from palpate_edge.geometry.sensor import View
from palpate_edge.kernels.blind_spot import BlindSpotKernel
from palpate_edge.kernels.canonical_field import CanonicalFieldKernel, FieldNoise, MeanMotion
from palpate_edge.vision.beads import Beads

# Rings (polar angle in deg, count) of canonical directions; each ring is symmetric about x-z. The last one is
# beyond all contacts: near the base the force shows in how the skin moves there.
CANONICAL_RINGS = (
    (0.0, 1),
    (12.0, 6),
    (24.0, 12),
    (36.0, 18),
    (48.0, 24),
    (60.0, 24),
    (72.0, 24),
    (82.0, 24),
)
KERNEL_LENGTH = 0.45  # on the unit sphere: about two bead spacings of the paper's layout
BEAD_NOISE = 1e-3  # variance of a bead's place, relative to the field's
NOISE_WEIGHT = 16.0  # of the noise's variance: a contact's field is smoother than the kernel's samples
LOST_NOISE = 1e9  # variance of a bead that was not found: its place counts for nothing
LEAST_SIGNAL = 0.1  # of a frame's mean square displacement; the rest is noise at most
PIXEL_STEP = 0.5  # of the finite differences
PER_COSINE = 6.0 / KERNEL_LENGTH**2  # 3 chord^2 / length^2, with chord^2 = 2 - 2 cos


class CanonicalField(msgspec.Struct, frozen=True):
    """One frame's displacement in the canonical frame.

    values (2 g,), mm: the meridional components at all g canonical directions, then the azimuthal ones;
    azimuth_rad: of the canonical frame's x axis in F; hidden: HiddenBeads.blind_spot.
    """

    values: Array
    azimuth_rad: float
    hidden: float


class HiddenBeads(msgspec.Struct, frozen=True):
    """The beads that were not found or are inexact.

    blind_spot: largest variance of the displacement at one of them, given the other beads', where an inexact
    bead's own measurement counts by its noise and a hidden one's not at all: 0 (known) to 1 (unknown). It is
    0.3 to 0.6 with a random 30 % of the paper's layout hidden, 0.74 or more with 20 neighbours hidden.
    """

    blind_spot: float


def canonical_directions() -> Array:
    """Return the unit vectors (g, 3), in the canonical frame, at which fields are evaluated."""
    rings = []
    for theta_deg, count in CANONICAL_RINGS:
        theta, phi = np.radians(theta_deg), 2 * np.pi * np.arange(count) / count
        x, y = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi)
        rings.append(np.stack([x, y, np.full(count, np.cos(theta))], axis=1))
    return np.concatenate(rings)


def mirrored(values: Array) -> Array:
    """Return the canonical fields (..., 2 g) of the mirrored presses (y -> -y)."""
    count = len(_DIRECTIONS)
    meridional, azimuthal = values[..., :count], values[..., count:]
    return np.concatenate([meridional[..., _MIRROR], -azimuthal[..., _MIRROR]], axis=-1)


class DisplacementReader:
    """Interpolates one sensor's beads to canonical fields."""

    def __init__(
        self,
        reference_px: Array,
        view: View,
        markers_radius_mm: float,
        noise_px: float = 0.0,
        typical: TypicalFields | None = None,
    ) -> None:
        """reference_px (n, 2): the untouched beads; view: the camera that sees them; noise_px: standard
        deviation of a bead's place along an axis; typical: by which displacements are smoothed."""
        self._reference_px = reference_px
        self._beads = view.onto_sphere(reference_px, markers_radius_mm) / markers_radius_mm
        self._mm_per_px = _jacobian(view, reference_px, markers_radius_mm)
        self._covariance = kernel(self._beads, self._beads)
        inverse = np.asarray(
            np.linalg.inv(self._covariance + BEAD_NOISE * np.eye(len(reference_px))), np.float64
        )
        self._blind_spot = BlindSpotKernel(inverse, BEAD_NOISE)
        self._noise_mm2 = noise_px**2 * float((self._mm_per_px**2).sum(axis=(1, 2)).mean())
        self._field = CanonicalFieldKernel(
            _DIRECTIONS,
            np.stack([_MERIDIONAL, _AZIMUTHAL]),
            self._beads,
            self._mm_per_px,
            self._covariance,
            FieldNoise(BEAD_NOISE, self._noise_mm2, NOISE_WEIGHT, LEAST_SIGNAL),
            length=KERNEL_LENGTH,
        )
        self._smoother = None if typical is None else FieldSmoother(typical, noise_px)
        self._smooths_all = typical is not None and typical.smooths_all
        self._azimuth_of_kernel_rad = math.nan

    @property
    def geometry(self) -> tuple[Array, Array]:
        """The beads' unit vectors (n, 3), and the displacement on the sphere, mm, for a pixel in x and in y,
        (n, 3, 2)."""
        return self._beads, self._mm_per_px

    def hidden(self, beads: Beads) -> HiddenBeads:
        """Return the beads that were not found or are inexact, and how well the others determine them."""
        if beads.all_exact:
            return NONE_HIDDEN
        return HiddenBeads(self._blind_spot.largest_variance(beads.found, beads.noise))

    def read(self, beads: Beads, turn_rad: float = 0.0, hidden: HiddenBeads | None = None) -> CanonicalField:
        """Return the canonical field of one frame.

        turn_rad: added to the canonical frame's azimuth, to vary training samples; hidden: result of
        :meth:`hidden` for these beads, if known.
        """
        pixels = self.displacement_px(beads)
        hidden = hidden or self.hidden(beads)
        if self._smoother is not None and (self._smooths_all or not beads.all_exact):
            smooth_px = self._smoother.smooth(pixels, beads)
            azimuth_rad, values = self._field.read(smooth_px, turn_rad, all_exact=False)
        elif beads.all_exact:
            azimuth_rad, values = self._field.read(pixels, turn_rad, all_exact=True)
        else:
            weights = self._inexact_weights(self._on_sphere_mm(pixels), beads)
            azimuth_rad = turn_rad + self._azimuth_rad(self._covariance @ weights)
            values = self._field.read_weighed(weights, azimuth_rad)
        self._azimuth_of_kernel_rad = azimuth_rad
        return CanonicalField(values, azimuth_rad, hidden.blind_spot)

    def displacement_px(self, beads: Beads) -> Array:
        """Return the measured displacement (n, 2) of the beads from the untouched ones."""
        return np.asarray(beads.position_px - self._reference_px)

    def mean_motion_mm(self, displacement_px: Array) -> MeanMotion:
        """Return the mean translation and rotation of the beads for their displacement (n, 2) in the image.

        A slide moves the first three components, a twist the last three; both are a mean over all beads, so
        their noise is that of one bead over the root of the count.
        """
        return self._field.mean_motion(displacement_px)

    def padded_kernel(self, azimuth_rad: float) -> Floats:
        """Return the covariance (g, padded n) of the canonical directions and the beads, read-only.

        azimuth_rad: of the canonical frame. There is one array, which holds the last covariance: a frame's
        field and the fit of its contact need the same.
        """
        if azimuth_rad != self._azimuth_of_kernel_rad:
            self._azimuth_of_kernel_rad = azimuth_rad
            self._field.turn(azimuth_rad)
        return self._field.covariance

    def _on_sphere_mm(self, displacement_px: Array) -> Array:
        """Return displacements (n, 3) on the sphere of displacements (n, 2) in the image."""
        return np.asarray(np.vecdot(self._mm_per_px, displacement_px[:, None]))

    def _inexact_weights(self, displacement_mm: Array, beads: Beads) -> Array:
        """Return the beads' weights (n, 3) in the Gaussian process of the displacement (n, 3), some of them
        hidden or inexact."""
        noise = NOISE_WEIGHT * self._relative_noise(displacement_mm, beads.weight)
        inexact = 1.0 if beads.noise is None else beads.noise.astype(np.float64) ** 2
        each = BEAD_NOISE + noise * inexact if self._noise_mm2 else BEAD_NOISE * inexact
        covariance = self._covariance.copy()
        covariance.ravel()[:: len(covariance) + 1] += np.where(beads.found, each, LOST_NOISE)
        return np.asarray(np.linalg.solve(covariance, displacement_mm * beads.found[:, None]))

    def _relative_noise(self, displacement_mm: Array, weight: Array) -> float:
        """Return the variance of an exact bead's place over that of the displacement (n, 3) of all beads.

        weight (n,): of each bead.
        """
        total = float(weight.sum())
        if not self._noise_mm2 or not total:
            return 0.0
        square = float(np.vecdot(displacement_mm, displacement_mm) @ weight) / total
        expected = self._noise_mm2 * np.count_nonzero(weight) / total
        return self._noise_mm2 / max(square - expected, LEAST_SIGNAL * square, 1e-12)

    def _azimuth_rad(self, displacement_mm: Array) -> float:
        """Return the azimuth of the centre of gravity of the squared displacement (n, 3)."""
        x, y, _ = np.vecdot(displacement_mm, displacement_mm) @ self._beads
        return math.atan2(y, x)


def kernel(a: Array, b: Array) -> Array:
    """Return the Matern 3/2 covariance (n, m) of directions (n, 3) and (m, 3), by their chord."""
    distance = np.sqrt(np.abs(PER_COSINE - (a * PER_COSINE) @ b.T))  # abs: rounding may leave it below 0
    return np.asarray((1.0 + distance) * np.exp(-distance))


def interpolation(directions: Array, turn_rad: float) -> Array:
    """Return the matrix (n, 3, 2 g) from canonical fields to the displacement at unit vectors (n, 3) of F.

    turn_rad: azimuth of the canonical frame.
    """
    turn = rotation_about_z(turn_rad)
    weights = kernel(directions, _DIRECTIONS @ turn.T) @ _inverse_kernel()
    parts = [weights[:, None, :] * (basis @ turn.T).T[None] for basis in (_MERIDIONAL, _AZIMUTHAL)]
    return np.concatenate(parts, axis=2)


def kernel_weights(fields: Array) -> Array:
    """Return the weights (m, g, 3), in the canonical frame, of the kernels about the canonical directions.

    Their sum is the displacement that canonical fields (m, 2 g) interpolate to.
    """
    count = len(_DIRECTIONS)
    moved = fields[:, :count, None] * _MERIDIONAL + fields[:, count:, None] * _AZIMUTHAL
    return np.asarray(_inverse_kernel() @ moved)


def _inverse_kernel() -> Array:
    """Return the inverse (g, g) of the covariance of the canonical directions, with the beads' noise."""
    covariance = kernel(_DIRECTIONS, _DIRECTIONS) + BEAD_NOISE * np.eye(len(_DIRECTIONS))
    return np.asarray(np.linalg.inv(covariance), dtype=np.float64)


def tangent_basis(directions: Array) -> tuple[Array, Array]:
    """Return the unit vectors (n, 3) of growing polar angle and of growing azimuth at each direction."""
    phi, theta = azimuth(directions), polar_angle(directions)
    meridional = np.stack([np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), -np.sin(theta)], axis=1)
    azimuthal = np.stack([-np.sin(phi), np.cos(phi), np.zeros_like(phi)], axis=1)
    return meridional, azimuthal


def _jacobian(view: View, reference_px: Array, radius_mm: float) -> Array:
    """Return the displacement on the sphere, mm, for a pixel of displacement in x and in y, (n, 3, 2)."""
    columns = []
    for step in (np.array([PIXEL_STEP, 0.0]), np.array([0.0, PIXEL_STEP])):
        ahead = view.onto_sphere(reference_px + step, radius_mm)
        behind = view.onto_sphere(reference_px - step, radius_mm)
        columns.append((ahead - behind) / (2 * PIXEL_STEP))
    return np.stack(columns, axis=2)


NONE_HIDDEN = HiddenBeads(0.0)
_DIRECTIONS = canonical_directions()
_MERIDIONAL, _AZIMUTHAL = tangent_basis(_DIRECTIONS)
_MIRROR = np.array([int(np.argmax(_DIRECTIONS @ (d * (1.0, -1.0, 1.0)))) for d in _DIRECTIONS])
