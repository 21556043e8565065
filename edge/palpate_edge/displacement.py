"""The displacement field of the skin in a frame that turns with the contact: what the correction model sees.

The dome is axisymmetric, so a press at one azimuth is the same press at any other, turned; and the mirror
image of a press is a press. Beads do not lie where the next sensor has them, and some are hidden. Therefore
the beads' motion is interpolated (Gaussian process, Matern 3/2 kernel on the sphere) and read off at fixed
directions of a *canonical frame*: F turned about z by the azimuth of the motion's centre of gravity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate_edge.sensor import View
from palpate_edge.tracking import Beads

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Rings (polar angle in deg, count) of canonical directions; each ring is its own mirror image about x-z.
CANONICAL_RINGS = ((0.0, 1), (12.0, 6), (24.0, 12), (36.0, 18), (48.0, 24), (60.0, 24), (72.0, 24))
KERNEL_LENGTH = 0.45  # on the unit sphere: about four bead spacings of the paper's layout
BEAD_NOISE = 1e-3  # variance of a bead's place relative to the field's
PIXEL_STEP = 0.5


@dataclass(frozen=True, slots=True)
class CanonicalField:
    """One frame's motion: values (2 g,) in mm, the meridional components of all canonical directions, then
    the azimuthal ones; azimuth_rad of the canonical frame's x axis in F; hidden: share of beads not found."""

    values: Array
    azimuth_rad: float
    hidden: float


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
    cos, sin = np.cos(azimuth_rad), np.sin(azimuth_rad)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


class DisplacementReader:
    """Turns one sensor's beads into canonical fields."""

    def __init__(self, reference_px: Array, view: View, markers_radius_mm: float) -> None:
        """From the untouched beads (n, 2) and the camera that sees them."""
        self._reference_px = reference_px
        self._beads = view.onto_sphere(reference_px, markers_radius_mm) / markers_radius_mm
        self._mm_per_px = _jacobian(view, reference_px, markers_radius_mm)
        self._kernel = kernel(self._beads, self._beads) + BEAD_NOISE * np.eye(len(reference_px))
        self._inverse = np.linalg.inv(self._kernel)

    def read(self, beads: Beads, turn_rad: float = 0.0) -> CanonicalField:
        """The canonical field of one frame; `turn_rad` turns the canonical frame (training's variety)."""
        pixels = beads.position_px - self._reference_px
        moved = (self._mm_per_px * pixels[:, None, :]).sum(axis=2)
        seen = beads.found
        azimuth = self._azimuth(moved, seen) + turn_rad
        if seen.all():
            weights = self._inverse @ moved
            beads_seen = self._beads
        else:
            weights = np.linalg.solve(self._kernel[np.ix_(seen, seen)], moved[seen])
            beads_seen = self._beads[seen]
        turn = about_z(azimuth)
        field = kernel(_DIRECTIONS @ turn.T, beads_seen) @ weights @ turn
        values = np.concatenate([(field * _MERIDIONAL).sum(axis=1), (field * _AZIMUTHAL).sum(axis=1)])
        return CanonicalField(values, float(azimuth), 1.0 - float(seen.mean()))

    def blind_spot(self, beads: Beads) -> float:
        """How little the found beads tell at the worst hidden one: variance there, 0 (known) to 1 (nothing).

        30 % of the paper's layout hidden at random leave 0.3 to 0.6; 20 neighbours hidden, 0.74 or more.
        """
        seen, hidden = beads.found, ~beads.found
        if not hidden.any() or not seen.any():
            return float(hidden.any())
        across = kernel(self._beads[hidden], self._beads[seen])
        explained = (across * np.linalg.solve(self._kernel[np.ix_(seen, seen)], across.T).T).sum(axis=1)
        return float(1.0 - explained.min())

    def _azimuth(self, moved: Array, seen: Mask) -> float:
        """Azimuth of the centre of gravity of the squared motion."""
        weight = (moved**2).sum(axis=1) * seen
        x, y, _ = weight @ self._beads
        return float(np.arctan2(y, x))


def kernel(a: Array, b: Array) -> Array:
    """Matern 3/2 covariance (n, m) of directions (n, 3) and (m, 3), by their chord."""
    chord = np.sqrt(np.maximum(0.0, 6.0 - 6.0 * (a @ b.T))) / KERNEL_LENGTH
    return np.asarray((1.0 + chord) * np.exp(-chord))


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


_DIRECTIONS = canonical_directions()
_MERIDIONAL, _AZIMUTHAL = tangent_basis(_DIRECTIONS)
_MIRROR = np.array([int(np.argmax(_DIRECTIONS @ (d * (1.0, -1.0, 1.0)))) for d in _DIRECTIONS])
