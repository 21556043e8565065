"""Adjustment of the dome model by presses through a jig's holes: a few numbers, for a few known places.

The dome as the camera sees it may be turned by three small angles, and its polar angles may be stretched by
two smooth functions of the polar angle. Nothing in that can bend between the holes, and nothing is learned of
shear, which such presses do not have. Each number has a normal distribution around 0, that of simulated
sensors; holes left out in turn decide whether the adjustment is used at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate_edge.calibration.training.dome_model import DomeModel
from palpate_edge.common.arrays import Array
from palpate_edge.estimation.calibration import JigErrors
from palpate_edge.vision.beads import Beads

# Standard deviations over sixteen sensors of the twin (seeds 60 to 67, 80 to 87), each with 200 presses.
# Beads of a known layout determine the camera's angles; a learned layout leaves them to its assembly.
DRAWN_TURN_RAD = (0.002, 0.002, 0.002)
LEARNED_TURN_RAD = (0.006, 0.006, 0.02)
STRETCH = (0.015, 0.06)
HOLE_RAD = 0.0093  # of a printed hole's axis, 0.5 deg and 0.1 mm; the same for all presses through it
PRESS_RAD = 0.012  # of the dome model's error for a single firm press
OUTLYING = 2.0  # standard deviations; presses farther off count less (Huber's estimate)
STEPS = 5
FEWEST_HOLES = 5
BETTER = 0.9  # squared error of holes left out, over that without the adjustment, from which it is used


@dataclass(frozen=True, slots=True)
class JigPress:
    """A press through a hole: its beads, the hole's axis as a unit vector (3,) in F, and motion.faintness."""

    beads: Beads
    direction: Array
    faintness: float


@dataclass(frozen=True, slots=True)
class DomeAdjustment:
    """numbers (5,): rotation vector of the dome in F, rad, and the two stretches, rad.

    errors: of the holes. All numbers are 0 where holes left out are not estimated better with them.
    """

    numbers: Array
    errors: JigErrors

    def stretched(self, dome: DomeModel) -> DomeModel:
        """Return the dome model with its contacts moved along their meridians, and the forces with them."""
        outward = dome.directions
        southward, angle = _southward(outward), _stretches(outward) @ self.numbers[3:]
        cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
        up, along = ((dome.forces * axis).sum(axis=1, keepdims=True) for axis in (outward, southward))
        forces = dome.forces + (cos - 1) * (up * outward + along * southward)
        forces += sin * (up * southward - along * outward)
        return replace(dome, directions=cos * outward + sin * southward, forces=forces)


def fit_adjustment(
    given: Array, presses: Sequence[JigPress], radius_mm: float, *, is_drawn: bool
) -> DomeAdjustment:
    """Return the likeliest adjustment, or none.

    given (n, 3): directions in F that the dome model estimates for the presses. is_drawn: whether the beads'
    layout is known. radius_mm: of the dome, on which the errors are measured.
    """
    true = np.array([press.direction for press in presses])
    _, hole, counts = np.unique(np.round(true, 6), axis=0, return_inverse=True, return_counts=True)
    hole = hole.ravel()
    faintness = np.array([press.faintness for press in presses])
    variance = HOLE_RAD**2 * counts[hole] + (PRESS_RAD * faintness) ** 2
    prior = np.array([*(DRAWN_TURN_RAD if is_drawn else LEARNED_TURN_RAD), *STRETCH])
    left_out = given.copy()
    for number in range(len(counts)):
        out = hole == number
        numbers = _likeliest(given[~out], true[~out], variance[~out], prior)
        left_out[out] = _moved(given[out], numbers)
    before, after = (np.linalg.norm(some - true, axis=1) for some in (given, left_out))
    is_used = (
        len(counts) >= FEWEST_HOLES and (after**2 / variance).sum() < BETTER * (before**2 / variance).sum()
    )
    numbers = _likeliest(given, true, variance, prior) if is_used else np.zeros(5)
    firm = faintness <= np.median(faintness)
    error_mm = (after if is_used else before)[firm].mean() * radius_mm
    errors = JigErrors(
        len(counts), len(presses), float(before[firm].mean() * radius_mm), float(error_mm), bool(is_used)
    )
    return DomeAdjustment(numbers, errors)


def _likeliest(given: Array, true: Array, variance: Array, prior: Array) -> Array:
    """Return the numbers (5,) by least squares with the prior's standard deviations (5,)."""
    change, off = _derivative(given), true - given
    weight = 1 / variance
    numbers = np.zeros(len(prior))
    for _ in range(STEPS):
        normal = np.einsum("n,nij,nik->jk", weight, change, change) + np.diag(prior**-2)
        numbers = np.linalg.solve(normal, np.einsum("n,nij,ni->j", weight, change, off))
        missed = np.linalg.norm(off - change @ numbers, axis=1) / np.sqrt(variance)
        weight = np.minimum(1.0, OUTLYING / np.maximum(missed, 1e-9)) / variance
    return numbers


def _moved(directions: Array, numbers: Array) -> Array:
    """Return the unit vectors (n, 3) after an adjustment."""
    moved = directions + _derivative(directions) @ numbers
    return np.asarray(moved / np.linalg.norm(moved, axis=1, keepdims=True))


def _derivative(directions: Array) -> Array:
    """Return the derivatives (n, 3, 5) of unit vectors (n, 3) by the numbers."""
    turns = np.cross(np.eye(3)[:, None], directions[None]).transpose(1, 2, 0)
    stretches = _southward(directions)[:, :, None] * _stretches(directions)[:, None, :]
    return np.concatenate([turns, stretches], axis=2)


def _stretches(directions: Array) -> Array:
    """Return the two functions of the polar angle, (n, 2): its sine, and one that is flat at the apex."""
    sine = np.hypot(directions[:, 0], directions[:, 1])
    return np.stack([sine, sine * (1 - directions[:, 2])], axis=1)


def _southward(directions: Array) -> Array:
    """Return the unit tangents (n, 3) of growing polar angle; any tangent at the apex, where none counts."""
    azimuth = np.arctan2(directions[:, 1], directions[:, 0])
    sine = np.hypot(directions[:, 0], directions[:, 1])
    return np.stack([directions[:, 2] * np.cos(azimuth), directions[:, 2] * np.sin(azimuth), -sine], axis=1)
