"""The displacement field of the skin in a frame that turns with the contact: what the correction model sees.

The dome is axisymmetric, so a press at one azimuth is the same press at any other, turned; and the mirror
image of a press is a press. Beads do not lie where the next sensor has them, and some are hidden. Therefore
the beads' motion is interpolated (Gaussian process, Matern 3/2 kernel on the sphere) and read off at fixed
directions of a *canonical frame*: F turned about z by the azimuth of the motion's centre of gravity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.arrays import Array, Indices, Mask
from palpate_edge.geometry.sensor import View
from palpate_edge.vision.tracker import Beads

Some = TypeVar("Some", Array, NDArray[np.float32])

# Rings (polar angle in deg, count) of canonical directions; each ring is its own mirror image about x-z.
CANONICAL_RINGS = ((0.0, 1), (12.0, 6), (24.0, 12), (36.0, 18), (48.0, 24), (60.0, 24), (72.0, 24))
KERNEL_LENGTH = 0.45  # on the unit sphere: about four bead spacings of the paper's layout
BEAD_NOISE = 1e-3  # variance of a bead's place relative to the field's
PIXEL_STEP = 0.5
PER_COSINE = 6.0 / KERNEL_LENGTH**2  # chord^2 = 2 - 2 cos, and 3 of it over the length's square


@dataclass(frozen=True, slots=True)
class CanonicalField:
    """One frame's motion: values (2 g,) in mm, the meridional components of all canonical directions, then
    the azimuthal ones; azimuth_rad of the canonical frame's x axis in F; hidden: Hidden.blind_spot."""

    values: Array
    azimuth_rad: float
    hidden: float


@dataclass(frozen=True, slots=True)
class Hidden:
    """The beads (h,) that a frame does not show; covariance (h, h) of their motion given the others'."""

    beads: Indices
    covariance: Array

    @property
    def blind_spot(self) -> float:
        """How little the found beads tell at the worst hidden one: variance there, 0 (known) to 1 (nothing).

        30 % of the paper's layout hidden at random leave 0.3 to 0.6; 20 neighbours hidden, 0.74 or more.
        """
        return float(self.covariance.diagonal().max()) - BEAD_NOISE if len(self.beads) else 0.0


def canonical_directions() -> Array:
    """Unit vectors (g, 3) of the canonical frame."""
    rings = []
    for theta_deg, count in CANONICAL_RINGS:
        theta, phi = np.radians(theta_deg), 2 * np.pi * np.arange(count) / count
        x, y = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi)
        rings.append(np.stack([x, y, np.full(count, np.cos(theta))], axis=1))
    return np.concatenate(rings)


def mirrored(values: Array) -> Array:
    """The canonical fields (..., 2 g) of the mirrored presses (y -> -y)."""
    count = len(_DIRECTIONS)
    meridional, azimuthal = values[..., :count], values[..., count:]
    return np.concatenate([meridional[..., _MIRROR], -azimuthal[..., _MIRROR]], axis=-1)


def about_z(azimuth_rad: float) -> Array:
    """(3, 3): canonical frame to F."""
    cos, sin = math.cos(azimuth_rad), math.sin(azimuth_rad)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


class DisplacementReader:
    """Turns one sensor's beads into canonical fields."""

    def __init__(self, reference_px: Array, view: View, markers_radius_mm: float) -> None:
        """From the untouched beads (n, 2) and the camera that sees them."""
        self._reference_px = reference_px
        self._beads = view.onto_sphere(reference_px, markers_radius_mm) / markers_radius_mm
        self._mm_per_px = _jacobian(view, reference_px, markers_radius_mm)
        covariance = kernel(self._beads, self._beads) + BEAD_NOISE * np.eye(len(reference_px))
        self._inverse = np.linalg.inv(covariance)
        self._beads_32 = self._beads.T.astype(np.float32)

    def hidden(self, beads: Beads) -> Hidden:
        """The beads that are not found."""
        if not len(beads.lost):
            return NONE_HIDDEN
        return Hidden(beads.lost, np.linalg.inv(self._inverse[np.ix_(beads.lost, beads.lost)]))

    def read(self, beads: Beads, turn_rad: float = 0.0, hidden: Hidden | None = None) -> CanonicalField:
        """The canonical field of one frame; `turn_rad` turns the canonical frame (training's variety).

        hidden: of these beads, where the caller has asked for them already.
        """
        pixels = beads.position_px - self._reference_px
        moved = np.vecdot(self._mm_per_px, pixels[:, None])
        hidden = hidden or self.hidden(beads)
        if len(hidden.beads):
            moved = self._filled(moved, beads.found, hidden)
        azimuth = self._azimuth(moved) + turn_rad
        weights = self._inverse @ moved
        turn = about_z(azimuth).astype(np.float32)  # float32: fields to 1e-6 in a third of the time
        covariance = _matern(_DIRECTIONS_32 @ (turn.T @ self._beads_32))
        field = covariance @ weights.astype(np.float32) @ turn
        values = np.vecdot(_TANGENTS, field).ravel().astype(np.float64)
        return CanonicalField(values, azimuth, hidden.blind_spot)

    def _filled(self, moved: Array, seen: Mask, hidden: Hidden) -> Array:
        """The motion (n, 3) with that of the hidden beads as the seen ones tell it: then the hidden ones'
        weights are 0, and the field is that of the seen ones alone."""
        told = self._inverse[hidden.beads] @ (moved * seen[:, None])
        filled = moved.copy()
        filled[hidden.beads] = -hidden.covariance @ told
        return filled

    def _azimuth(self, moved: Array) -> float:
        """Azimuth of the centre of gravity of the squared motion (n, 3)."""
        x, y, _ = np.vecdot(moved, moved) @ self._beads
        return math.atan2(y, x)


def kernel(a: Some, b: Some) -> Some:
    """Matern 3/2 covariance (n, m) of directions (n, 3) and (m, 3), by their chord."""
    return _matern(np.asarray((a * -PER_COSINE) @ b.T, a.dtype))


def _matern(chord: Some) -> Some:
    """chord: the directions' products times -PER_COSINE; its memory is used."""
    chord += PER_COSINE
    np.sqrt(np.abs(chord, out=chord), out=chord)  # abs: rounding leaves it below 0 by a hair
    growth = np.exp(chord)
    chord += 1.0
    chord /= growth
    return np.asarray(chord)


def tangent_basis(directions: Array) -> tuple[Array, Array]:
    """Unit vectors (n, 3) of growing polar angle and of growing azimuth at each direction."""
    x, y, z = directions.T
    phi, theta = np.arctan2(y, x), np.arctan2(np.hypot(x, y), z)
    meridional = np.stack([np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), -np.sin(theta)], axis=1)
    azimuthal = np.stack([-np.sin(phi), np.cos(phi), np.zeros_like(phi)], axis=1)
    return meridional, azimuthal


def _jacobian(view: View, reference_px: Array, radius_mm: float) -> Array:
    """(n, 3, 2): motion on the sphere, mm, for a pixel of motion in x and in y."""
    columns = []
    for step in (np.array([PIXEL_STEP, 0.0]), np.array([0.0, PIXEL_STEP])):
        ahead = view.onto_sphere(reference_px + step, radius_mm)
        behind = view.onto_sphere(reference_px - step, radius_mm)
        columns.append((ahead - behind) / (2 * PIXEL_STEP))
    return np.stack(columns, axis=2)


NONE_HIDDEN = Hidden(np.empty(0, np.intp), np.empty((0, 0)))
_DIRECTIONS = canonical_directions()
_MERIDIONAL, _AZIMUTHAL = tangent_basis(_DIRECTIONS)
_DIRECTIONS_32 = (-PER_COSINE * _DIRECTIONS).astype(np.float32)
_TANGENTS = np.stack([_MERIDIONAL, _AZIMUTHAL]).astype(np.float32)
_MIRROR = np.array([int(np.argmax(_DIRECTIONS @ (d * (1.0, -1.0, 1.0)))) for d in _DIRECTIONS])
