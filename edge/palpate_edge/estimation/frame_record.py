"""The record of one frame: it passes through the stages of the estimator, and each adds what it finds."""

from __future__ import annotations

from dataclasses import dataclass, field

import msgspec

from palpate_edge.common.contact import Contact, Vector3, refused_contact
from palpate_edge.common.frame import Frame
from palpate_edge.estimation.displacement_field import HiddenBeads
from palpate_edge.estimation.skin_motion import Motion
from palpate_edge.estimation.touch_classification import SkinState
from palpate_edge.vision.beads import Beads


class FrameRejectedError(Exception):
    """A frame that gives no valid contact; the message is the reason that is published."""


class LocatedContact(msgspec.Struct, frozen=True):
    """Position, force and uncertainty of a contact as a method estimates them.

    position_mm: on the outer sphere in F; None when nothing touches. normal_force_N, force_N, radius95_mm and
    the last three: None where the method gives none. misfit and the last three: see
    correction_model.Correction.
    """

    position_mm: Vector3 | None
    normal_force_N: float | None
    force_N: Vector3 | None
    radius95_mm: float | None
    misfit: float = 0.0
    force95_N: float | None = None
    torsion_Nmm: float | None = None
    torsion95_Nmm: float | None = None


NO_CONTACT = LocatedContact(None, 0.0, (0.0, 0.0, 0.0), None)


@dataclass(slots=True, eq=False, repr=False)
class FrameRecord:
    """One frame and the results of the stages that it has passed.

    A field is set by the stage that its comment names; to read it earlier raises AttributeError.
    """

    frame: Frame
    found_count: int = 0  # track
    tracked: Beads = field(init=False)  # track: the beads as the camera shows them
    hidden: HiddenBeads = field(init=False)  # track
    beads: Beads = field(init=False)  # compensate drift
    motion: Motion = field(init=False)  # compensate drift: of `beads`
    skin: SkinState = field(init=False)  # classify
    located: LocatedContact = NO_CONTACT  # locate
    radius95_mm: float | None = None  # validate

    def contact(self) -> Contact:
        """Return the contact of a frame that passed all stages."""
        expected = len(self.beads.found)
        return Contact(
            sequence=self.frame.sequence,
            exposed_at_us=self.frame.exposed_at_us,
            valid=True,
            in_contact=self.skin is SkinState.TOUCHED,
            position_mm=self.located.position_mm,
            normal_force_N=self.located.normal_force_N,
            force_N=self.located.force_N,
            quality=self.found_count / expected,
            reason="",
            beads_found=self.found_count,
            beads_expected=expected,
            radius95_mm=self.radius95_mm,
            force95_N=self.located.force95_N,
            torsion_Nmm=self.located.torsion_Nmm,
            torsion95_Nmm=self.located.torsion95_Nmm,
        )

    def refused(self, reason: str, expected: int) -> Contact:
        """Return the contact of a rejected frame; expected: number of the sensor's beads."""
        return refused_contact(
            self.frame.sequence, self.frame.exposed_at_us, reason, self.found_count, expected
        )
