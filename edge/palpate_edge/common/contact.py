"""The value that crosses from the estimator to the bus, the CSV and the host's view: one frame's contact.

All vectors are in the fingertip frame F (origin at the dome's centre, +z to the apex).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec

from palpate_edge.common.contact_quantities import FlatPose, OptionalQuantities

Vector3 = tuple[float, float, float]

MIN_BEADS_SHARE = 0.6  # of the beads that a frame must show; with fewer it is rejected


class LabelEstimate(msgspec.Struct, frozen=True):
    """Estimate of a pose label in its unit; with 95 % probability the truth is within half_width95."""

    label: str
    value: float
    half_width95: float


@dataclass(frozen=True, slots=True)
class Contact(OptionalQuantities):
    """Estimate of one frame.

    sequence, exposed_at_us: of the frame it was estimated from.
    valid: False when the frame was refused; then nothing but `reason` and the bead counts has a meaning.
    in_contact: something touches the dome.
    position_mm: where, on the outer undeformed sphere; None when nothing touches.
    normal_force_N: along the inward normal at that point, >= 0; None when unknown.
    force_N: the whole force on the dome; None when the method gives none.
    quality: 0 (refused) to 1 (every bead seen, all of them plausible).
    reason: why the frame was refused; empty when valid.
    beads_found, beads_expected: counts of markers.
    slip: what touches slides over the skin (see slip.py).
    slip_begins: the skin stopped following the object, as when slip begins (see slip_onset.py).
    pose: of a flat object, one estimate for each label that the calibration learned.
    """

    sequence: int
    exposed_at_us: int
    valid: bool
    in_contact: bool
    position_mm: Vector3 | None
    normal_force_N: float | None
    force_N: Vector3 | None
    quality: float
    reason: str
    beads_found: int
    beads_expected: int
    slip: bool = False
    pose: tuple[LabelEstimate, ...] = ()
    slip_begins: bool = False

    @property
    def flat_pose(self) -> FlatPose | None:
        """The pose with its half widths; None when no label was learned."""
        if not self.pose:
            return None
        values = {estimate.label: estimate.value for estimate in self.pose}
        return FlatPose(**values, **{f"{one.label}_95": one.half_width95 for one in self.pose})

    @property
    def shear_N(self) -> Vector3 | None:
        """The part of the force across the normal at the contact; None when force or position is unknown."""
        if self.position_mm is None or self.force_N is None:
            return None
        return tangential_force_N(self.position_mm, self.force_N)


def tangential_force_N(position_mm: Vector3, force_N: Vector3) -> Vector3:
    """Return the part of `force_N` across the sphere's normal at `position_mm`; NaN at the centre."""
    distance_mm = math.hypot(*position_mm)
    if distance_mm == 0.0:
        return math.nan, math.nan, math.nan
    (x, y, z), (x_N, y_N, z_N) = position_mm, force_N
    along_N_mm = (x_N * x + y_N * y + z_N * z) / distance_mm / distance_mm
    return x_N - along_N_mm * x, y_N - along_N_mm * y, z_N - along_N_mm * z


def refused_contact(
    sequence: int, exposed_at_us: int, reason: str, beads_found: int, beads_expected: int
) -> Contact:
    """Return the contact of a rejected frame."""
    return Contact(
        sequence=sequence,
        exposed_at_us=exposed_at_us,
        valid=False,
        in_contact=False,
        position_mm=None,
        normal_force_N=None,
        force_N=None,
        quality=0.0,
        reason=reason,
        beads_found=beads_found,
        beads_expected=beads_expected,
    )
