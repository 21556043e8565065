"""The value that crosses from the estimator to the bus, the CSV and the host's view: one frame's contact.

All vectors are in the fingertip frame F (origin at the dome's centre, +z to the apex).
"""

from __future__ import annotations

from dataclasses import dataclass

Vector3 = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Contact:
    """What one frame says of touch.

    sequence, exposed_at_us: of the frame it was estimated from.
    valid: False when the frame was refused; then nothing but `reason` and the bead counts has a meaning.
    in_contact: something touches the dome.
    position_mm: where, on the outer undeformed sphere; None when nothing touches.
    normal_force_N: along the inward normal at that point, >= 0; None when unknown.
    force_N: the whole force on the dome; None when the method gives none.
    torsion_Nmm: about the inward normal; None when the method gives none.
    quality: 0 (refused) to 1 (every bead seen, all of them plausible).
    reason: why the frame was refused; empty when valid.
    beads_found, beads_expected: counts of markers.
    radius95_mm: with 95 % probability the contact is no farther from position_mm; None when unknown.
    slip: what touches slides over the skin (see slip.py).
    """

    sequence: int
    exposed_at_us: int
    valid: bool
    in_contact: bool
    position_mm: Vector3 | None
    normal_force_N: float | None
    force_N: Vector3 | None
    torsion_Nmm: float | None
    quality: float
    reason: str
    beads_found: int
    beads_expected: int
    radius95_mm: float | None = None
    slip: bool = False


def refused_contact(
    sequence: int, exposed_at_us: int, reason: str, beads_found: int, beads_expected: int
) -> Contact:
    """The contact of a frame that cannot be believed."""
    return Contact(
        sequence=sequence,
        exposed_at_us=exposed_at_us,
        valid=False,
        in_contact=False,
        position_mm=None,
        normal_force_N=None,
        force_N=None,
        torsion_Nmm=None,
        quality=0.0,
        reason=reason,
        beads_found=beads_found,
        beads_expected=beads_expected,
    )
