"""Registration of two sensors of one kind: which marker is which, and a smooth map between their images.

Both have the same layout, so that their markers at rest differ by a shift, a scale and a little warp. How a
camera is mounted about the sensor's axis is no concern of this file: a skin that is alike in all directions
deforms alike in every picture, and label_axes.py turns the labels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array, Indices
from palpate_edge.common.errors import CalibrationError
from palpate_edge.geometry.points import distances, spacing

ROUNDS = 40
DEGREES = (1, 3)  # of the polynomial in the first rounds and in the others
FIRST_ROUNDS = 12
TURNS_DEG = tuple(range(-30, 31, 5))  # tried at first; a hexagon is alike again after 60
MAX_APART = 0.2  # pitches, root mean square
TURN_TOLERANCE_RAD = np.radians(5.0)  # of a layout onto itself: another turn was found from this one


@dataclass(frozen=True, slots=True)
class RestRegistration:
    """order (n,): the other sensor's marker for each of this one; a polynomial map from the other's image."""

    order: Indices
    centre_px: Array
    scale_px: float
    coefficients: Array

    def map(self, places_px: Array) -> Array:
        """Return places (m, 2) of the other sensor's image in this one's."""
        return np.asarray(
            _powers((places_px - self.centre_px) / self.scale_px, DEGREES[1]) @ self.coefficients
        )

    def displacement_here(self, other_px: Array, displacement_px: Array) -> Array:
        """Return displacements (s, 2 n) of the other sensor's markers, at rest at other_px (n, 2), as this
        sensor's markers in its image."""
        moved = displacement_px.reshape(len(displacement_px), -1, 2) + other_px
        here = self.map(moved.reshape(-1, 2)).reshape(moved.shape) - self.map(other_px)
        return np.asarray(here[:, self.order].reshape(len(here), -1))


def register_rest(own_px: Array, other_px: Array) -> RestRegistration:
    """Register markers at rest (n, 2) of another sensor with those of this one.

    Raises CalibrationError when their numbers differ or the layouts do not fit.
    """
    if len(own_px) != len(other_px):
        raise CalibrationError(
            f"the pose model is of sensors with {len(other_px)} markers, this one has {len(own_px)}: "
            "train a model with sensors of this kind, or leave --dome-model out"
        )
    found = [_register(own_px, other_px, np.deg2rad(turn)) for turn in sorted(TURNS_DEG, key=abs)]
    apart = [_apart(registration, own_px, other_px) for registration in found]
    best = int(np.argmin(apart))
    if apart[best] > MAX_APART:
        raise CalibrationError(
            f"the markers at rest differ from those of the pose model by {apart[best]:.2f} spacings, at most "
            f"{MAX_APART} are allowed: train a model with sensors of this layout, or leave --dome-model out"
        )
    return found[best]


def register_turned(rest_px: Array, turn_rad: float) -> RestRegistration | None:
    """Register markers at rest (n, 2), turned about their middle, with themselves; None where that turn does
    not bring each marker to the place of one."""
    registration = _register(rest_px, rest_px, turn_rad)
    if _apart(registration, rest_px, rest_px) > MAX_APART:
        return None
    before, after = (
        (rest_px[order] - rest_px.mean(axis=0)) @ (1, 1j) for order in (registration.order, slice(None))
    )
    found_rad = np.angle(np.vdot(before * np.exp(1j * turn_rad), after))
    return registration if abs(found_rad) < TURN_TOLERANCE_RAD else None


def _apart(registration: RestRegistration, own_px: Array, other_px: Array) -> float:
    off = registration.map(other_px[registration.order]) - own_px
    if len(np.unique(registration.order)) < len(own_px):
        return np.inf
    return float(np.sqrt(np.square(off).sum(axis=1).mean()) / np.median(spacing(own_px)))


def _register(own_px: Array, other_px: Array, turn_rad: float) -> RestRegistration:
    """Return the registration that is found from one turn by nearness and refitting."""
    centre, scale = other_px.mean(axis=0), _size(other_px)
    normal = (other_px - centre) / scale
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    placed = own_px.mean(axis=0) + normal @ np.array([[c, s], [-s, c]]) * _size(own_px)
    for number in range(ROUNDS):
        degree = DEGREES[number >= FIRST_ROUNDS]
        apart = distances(own_px, placed)
        order = apart.argmin(axis=1)
        mutual = apart.argmin(axis=0)[order] == np.arange(len(own_px))
        powers = _powers(normal, degree)
        coefficients = np.linalg.lstsq(powers[order[mutual]], own_px[mutual], rcond=None)[0]
        placed = powers @ coefficients
    return RestRegistration(order, centre, scale, coefficients)


def _size(places_px: Array) -> float:
    return float(np.sqrt(np.square(places_px - places_px.mean(axis=0)).sum(axis=1).mean()))


def _powers(places: Array, degree: int) -> Array:
    x, y = places.T
    return np.stack([x**i * y**j for i in range(degree + 1) for j in range(degree + 1 - i)], axis=1)
