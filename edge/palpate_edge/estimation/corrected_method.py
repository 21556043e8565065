"""The corrected method: canonical displacement field -> correction model -> contact position and force."""

from __future__ import annotations

import msgspec

from palpate_edge.common.errors import CalibrationError
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.estimation.contact_fit.contact_fields import ContactFields
from palpate_edge.estimation.contact_fit.contact_fitter import ContactFitter, FitStart
from palpate_edge.estimation.contact_fit.place_stiffness import PlaceStiffness, StiffnessMap
from palpate_edge.estimation.correction_model import Correction, CorrectionModel
from palpate_edge.estimation.displacement_field import CanonicalField, DisplacementReader
from palpate_edge.estimation.frame_record import FrameRecord, LocatedContact
from palpate_edge.estimation.skin_motion import faintness

# The fitted contact leaves less of any field than the correction model's answer, of two presses' as well. On
# four sensors in hard light, of 597 single presses none is refused with this factor (1 by the answer's
# misfit), and of 1,243 frames spliced of two presses 5.9 % pass (9.3 %).
FITTED_MISFIT = 2.0


class CorrectedMethod:
    """Locates contacts with the calibration's correction model."""

    def __init__(self, calibration: Calibration, reader: DisplacementReader, model: CorrectionModel) -> None:
        """reader: of the beads' reference."""
        self._dome_radius_mm = calibration.sensor.dome.outer_radius_mm
        self._gives_force = calibration.stiffness_scale is not None
        self._threshold_px = calibration.contact_threshold_px
        self._reader = reader
        self._model = model
        fields = calibration.contact_fields
        self._fitter: ContactFitter | None = None
        if isinstance(fields, ContactFields):
            self._fitter = ContactFitter(fields, reader, calibration.noise_px)
        stiffness = calibration.place_stiffness
        self._stiffness = StiffnessMap(stiffness) if isinstance(stiffness, PlaceStiffness) else None

    def locate(self, record: FrameRecord) -> LocatedContact:
        """Return the contact; the normal force is the force's component along the inward normal."""
        field = self._reader.read(record.beads, hidden=record.hidden)
        result = self._model.correct(field)
        if self._fitter is not None:
            result = self._improved(self._fitter, result, field, record)
        (x, y, z), (x_N, y_N, z_N) = result.direction, result.force_N
        if self._stiffness is not None:
            x_N, y_N, z_N = self._stiffness.corrected(result.direction, result.force_N)
        radius_mm = self._dome_radius_mm
        position = radius_mm * x, radius_mm * y, radius_mm * z
        located = LocatedContact(
            position,
            None,
            None,
            result.radius95_mm,
            result.misfit,
            torsion_Nmm=result.torsion_Nmm,
            torsion95_Nmm=result.torsion95_Nmm,
        )
        if not self._gives_force:
            return located
        normal_N = max(0.0, -(x * x_N + y * y_N + z * z_N))
        return msgspec.structs.replace(
            located, normal_force_N=normal_N, force_N=(x_N, y_N, z_N), force95_N=result.force95_N
        )

    def _improved(
        self, fitter: ContactFitter, result: Correction, field: CanonicalField, record: FrameRecord
    ) -> Correction:
        """Return the correction with the place that fits the measured displacement better."""
        motion = record.motion
        start = FitStart(
            result.direction,
            result.force_N,
            field,
            faintness(motion.size_px / motion.noise, self._threshold_px),
        )
        direction, misfit = fitter.combine(record.beads, start)
        return msgspec.structs.replace(
            result,
            direction=direction,
            radius95_mm=fitter.radius_scale * result.radius95_mm,
            misfit=FITTED_MISFIT * misfit,
        )


def load_model(calibration: Calibration) -> CorrectionModel:
    """Load the calibration's correction model.

    Raises CalibrationError when the calibration has none, or one that cannot be used.
    """
    if not calibration.model:
        raise CalibrationError(
            "the calibration holds no correction model: choose the method paper, or run palpate-edge "
            "calibrate with presses"
        )
    return CorrectionModel(calibration.model, calibration.sensor.fingerprint())
