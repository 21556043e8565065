"""Validation of a located contact: whether a single contact fits, and the uncertainty of faint ones."""

from __future__ import annotations

from palpate_edge.estimation.calibration import Calibration
from palpate_edge.estimation.frame_record import FrameRecord, FrameRejectedError
from palpate_edge.estimation.skin_motion import faintness
from palpate_edge.estimation.touch_classification import SkinState

# Limit of Correction.misfit for a firm press of known position; its growth with the noise, times the square
# of contact threshold over motion; its growth with the position's uncertainty, times the square of radius95
# over the dome's radius. On eight sensors with 0, 20 and all presses these limits reject 14 of 1,422 single
# presses, and 98.4 % of the frames spliced from two presses.
MAX_MISFIT, NOISE_MISFIT, POSITION_MISFIT = 0.05, 8.0, 5.0


class ContactValidation:
    """Validates the contacts of one sensor."""

    def __init__(self, calibration: Calibration) -> None:
        self._threshold_px = calibration.contact_threshold_px
        self._dome_radius_mm = calibration.sensor.dome.outer_radius_mm

    def validate(self, record: FrameRecord) -> None:
        """Set the record's radius95_mm.

        Raise FrameRejectedError when the camera was knocked or no single contact fits the displacement.
        """
        if record.skin is SkinState.KNOCKED:
            raise FrameRejectedError("all beads moved together (camera knocked out of place): tare")
        if record.skin is not SkinState.TOUCHED:
            return
        motion_px, located = record.motion.size_px / record.motion.noise, record.located
        record.radius95_mm = self._radius95_mm(located.radius95_mm, motion_px)
        noise = self._threshold_px / motion_px
        position = (record.radius95_mm or 0.0) / self._dome_radius_mm
        limit = MAX_MISFIT + NOISE_MISFIT * noise**2 + POSITION_MISFIT * position**2
        if located.misfit > limit:
            raise FrameRejectedError(
                "displacement does not fit a single contact (torn frame or several contacts)"
            )

    def _radius95_mm(self, radius95_mm: float | None, motion_px: float) -> float | None:
        """Scale the 95 % radius for faint contacts, at most to the dome's radius: position unknown."""
        if radius95_mm is None:
            return None
        return min(radius95_mm * faintness(motion_px, self._threshold_px), self._dome_radius_mm)
