"""The estimator: frame -> contact, one line of stages on one record a frame.

check image -> track beads -> compensate drift -> check beads -> classify touch -> locate contact -> validate.
A stage that cannot go on raises FrameRejectedError with the reason. No input or output, no clock.
"""

from __future__ import annotations

from dataclasses import replace

from palpate_edge.common.contact import Contact
from palpate_edge.common.contact_quantities import SensorOutputs
from palpate_edge.common.frame import Frame
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.estimation.contact_validation import ContactValidation
from palpate_edge.estimation.corrected_method import CorrectedMethod, load_model
from palpate_edge.estimation.displacement_field import DisplacementReader
from palpate_edge.estimation.drift import Drift
from palpate_edge.estimation.frame_estimator import BeadsInView, EstimatorHealth, Method
from palpate_edge.estimation.frame_record import FrameRecord, FrameRejectedError
from palpate_edge.estimation.image_check import ImageCheck
from palpate_edge.estimation.paper_method import PaperMethod
from palpate_edge.estimation.plausibility import ImplausibleBeadsError, check_beads, check_blind_spot
from palpate_edge.estimation.skin_motion import SkinMotion
from palpate_edge.estimation.slip import SlipDetector
from palpate_edge.estimation.slip_onset import LoadHistory, detect_onset
from palpate_edge.estimation.tare import Tare
from palpate_edge.estimation.touch_classification import SkinState, TouchClassifier
from palpate_edge.estimation.virtual_points import VirtualPointMesh
from palpate_edge.geometry.sensor import View
from palpate_edge.vision.beads import Reference
from palpate_edge.vision.tracker import Tracker

Locator = PaperMethod | CorrectedMethod


def best_method(calibration: Calibration) -> Method:
    """Return the corrected method when the calibration has a correction model, else the paper's."""
    return Method.CORRECTED if calibration.model else Method.PAPER


class Estimator:
    """Estimates contact and force of one sensor, by the paper's method or by the correction model.

    State from frame to frame: the beads' last places, the tare, the drift, and the last second's contacts and
    loads.
    picture: None, since the health of a calibrated sensor is that of its beads.
    """

    picture = None

    def __init__(self, calibration: Calibration, method: Method | None = None) -> None:
        """method: :func:`best_method` if not given.

        Raises CalibrationError when the calibration has no correction model for it, or an unusable one.
        """
        self.method = method or best_method(calibration)
        self._calibration = calibration
        self._model = load_model(calibration) if self.method is Method.CORRECTED else None
        self._view = View(calibration.sensor.camera, calibration.pose)
        reference = calibration.reference()
        self._image_check = ImageCheck(calibration.sensor.image_size_px, calibration.appearance.channel)
        self._tracker = Tracker(reference)
        self._tare = Tare(reference, self._use_reference)
        self._validation = ContactValidation(calibration)
        self._slip = SlipDetector()
        self._loads: LoadHistory = ()
        self._refused = 0
        self._last: FrameRecord | None = None
        self._use_reference(reference)

    def estimate(self, frame: Frame) -> Contact:
        """Return the contact of the next frame; a rejected frame gives `valid` False and the reason."""
        record = self._last = FrameRecord(frame)
        try:
            self._image_check.check_image(frame.image)
            record.tracked = self._tracker.follow_image(frame.image, self._calibration.appearance)
            record.found_count = record.tracked.found_count
            record.hidden = self._reader.hidden(record.tracked)
            record.motion = self._skin_motion.measure(record.tracked, self._drift.field)
            record.beads = record.tracked.moved_to(record.motion.position_px)
            check_beads(record)
            record.skin = self._classifier.classify(record.motion, frame.exposed_at_us)
            self._tare.collect(record.tracked, is_touched=record.skin is SkinState.TOUCHED)
            if record.skin is SkinState.TOUCHED:
                record.located = self._locator.locate(record)
            check_blind_spot(record)
            self._validation.validate(record)
        except FrameRejectedError as rejection:
            if isinstance(rejection, ImplausibleBeadsError):
                self._tracker.reset()
            self._refused += 1
            return record.refused(str(rejection), len(self._calibration.beads))
        contact = record.contact()
        slips = self._slip.detect(contact)
        skin_mm = self._reader.mean_motion_mm(record.motion.displacement_px)
        self._loads, slip_begins = detect_onset(self._loads, contact, skin_mm)
        return replace(contact, slip=slips, slip_begins=slip_begins) if slips or slip_begins else contact

    def tare(self, *, accepts_contact: bool = True) -> None:
        """Take the mean of the next `tare.TARE_FRAMES` plausible frames as the untouched sensor.

        accepts_contact: False cancels the tare when one of them shows a contact.
        """
        self._tare.begin(accepts_contact=accepts_contact)

    @property
    def outputs(self) -> SensorOutputs:
        """The outputs of the calibration: a contact's place, and its force unless the presses had none."""
        calibration = self._calibration
        if self.method is Method.CORRECTED:
            return SensorOutputs(force=calibration.stiffness_scale is not None)
        return SensorOutputs(force=bool(calibration.paper.stiffness_N_px))

    @property
    def health(self) -> EstimatorHealth:
        """Counters since the start, and the drift."""
        counters = self._tracker.counters
        return EstimatorHealth(
            counters.frames, self._refused, counters.beads_lost, counters.searches, self._drift.total_px
        )

    @property
    def beads(self) -> BeadsInView | None:
        """The beads of the last frame; rest: of the untouched skin, moved by the drift."""
        record = self._last
        tracked = getattr(record, "tracked", None)
        if record is None or tracked is None:
            return None
        beads = getattr(record, "beads", tracked)  # a frame may be rejected before the drift is known
        rest_px = self._rest_px + tracked.position_px - beads.position_px
        return BeadsInView(tracked.position_px, rest_px, tracked.found)

    def _use_reference(self, reference: Reference) -> None:
        """Measure motion, drift and contacts from `reference` on."""
        self._rest_px = reference.position_px
        self._loads = ()
        calibration = self._calibration
        threshold_px, sensor = calibration.contact_threshold_px, calibration.sensor
        self._skin_motion = SkinMotion(reference)
        self._drift = Drift(reference, threshold_px)
        self._classifier = TouchClassifier(self._drift, threshold_px)
        self._reader = DisplacementReader(
            reference.position_px,
            self._view,
            sensor.markers.radius_mm,
            calibration.noise_px,
            calibration.typical_fields,
        )
        if self._model is not None:
            self._locator: Locator = CorrectedMethod(calibration, self._reader, self._model)
        else:
            mesh = VirtualPointMesh(reference.position_px, calibration.ring_of())
            self._locator = PaperMethod(calibration.paper, mesh, sensor, self._view)
