"""Plausibility of a frame's beads: whether they belong to this skin and show enough of it."""

from __future__ import annotations

from palpate_edge.common.contact import MIN_BEADS_SHARE
from palpate_edge.estimation.frame_record import FrameRecord, FrameRejectedError
from palpate_edge.estimation.skin_motion import MAX_ROUGHNESS
from palpate_edge.estimation.touch_classification import SkinState

MAX_DOUBT = 0.03  # Match.doubt: two of 85 beads; labels a row off leave over the beads of one side
MAX_BLIND_SPOT = 0.65  # HiddenBeads.blind_spot; a contact in a larger one could not be seen


def check_beads(record: FrameRecord) -> None:
    """Raise ImplausibleBeadsError for too few or doubtful beads, or another skin's."""
    found, expected = record.found_count, len(record.beads.found)
    check_found(found, expected)
    check_doubt(record.tracked.doubt)
    check_smooth(record.motion.roughness)


def check_blind_spot(record: FrameRecord) -> None:
    """Raise FrameRejectedError for a hidden region in which a contact could be.

    A contact that is seen elsewhere is the only one, and its 95 % radius grows with the hidden beads.
    """
    seen_elsewhere = record.skin is SkinState.TOUCHED and record.located.radius95_mm is not None
    if record.hidden.blind_spot > MAX_BLIND_SPOT and not seen_elsewhere:
        raise FrameRejectedError("all beads of a region are hidden: a contact there could not be detected")


def check_found(found: int, expected: int) -> None:
    """Raise ImplausibleBeadsError where too few beads were found."""
    if found < MIN_BEADS_SHARE * expected:
        raise ImplausibleBeadsError(f"only {found} of {expected} beads found")


def check_doubt(doubt: float) -> None:
    """Raise ImplausibleBeadsError for labels that may be wrong; doubt: see correspondence.Match."""
    if doubt > MAX_DOUBT:
        raise ImplausibleBeadsError(
            "beads and blobs are left over side by side: the labels may be one row off"
        )


def check_smooth(roughness: float) -> None:
    """Raise ImplausibleBeadsError for beads that do not move as one skin; roughness: see Motion."""
    if roughness > MAX_ROUGHNESS:
        raise ImplausibleBeadsError("displacements of the beads are not smooth (another sensor, or no dome)")


class ImplausibleBeadsError(FrameRejectedError):
    """Beads that may bear wrong numbers: the tracker has to start again from the reference."""
