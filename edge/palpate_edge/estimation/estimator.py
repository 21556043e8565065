"""Frame -> Contact: the pipeline on a fingertip, pure, no I/O, no clock."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import cv2
import numpy as np

from palpate_edge.common.arrays import Array, Image
from palpate_edge.common.contact import Contact, Vector3, refused_contact
from palpate_edge.common.errors import CalibrationError
from palpate_edge.common.frame import Frame
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.estimation.correction_model import CorrectionModel
from palpate_edge.estimation.displacement_field import DisplacementReader, Hidden
from palpate_edge.estimation.drift import Drift, Skin
from palpate_edge.estimation.paper_method import corrected_theta, normal_force, on_dome, raw_contact
from palpate_edge.estimation.skin_motion import MAX_ROUGHNESS, Motion, SkinMotion, faintness
from palpate_edge.estimation.slip import SlipWatch
from palpate_edge.estimation.virtual_points import VirtualPointMesh
from palpate_edge.geometry.sensor import View
from palpate_edge.vision.blob_detection import plane
from palpate_edge.vision.tracker import Beads, Reference, Tracker

MIN_BEADS_SHARE = 0.6  # of the beads must be found for a frame to be believed
MIN_DEVIATION = 2.0  # grey levels over the image; less is a blank frame
BLANK_ROWS = 40  # of so many rows one is looked at
TARE_FRAMES = 10
MAX_BLIND_SPOT = 0.65  # Hidden.blind_spot: a contact there could not be seen
# Correction.misfit of a firm press of known place; what noise adds to a motion of the contact threshold's
# size; what an answer adds that is a 95 % radius off, over the square of that radius in parts of the dome's.
# On eight sensors with 0, 20 and all presses this refuses 14 of 1,422 sound presses, and 98.4 % of splices.
MAX_MISFIT, NOISE_MISFIT, ANSWER_MISFIT = 0.05, 8.0, 5.0


@dataclass(frozen=True, slots=True)
class _Touch:
    """Where and how hard, before it is put into a Contact."""

    position_mm: Vector3 | None
    normal_force_N: float | None
    force_N: Vector3 | None
    radius95_mm: float | None
    misfit: float = 0.0


NO_TOUCH = _Touch(None, 0.0, (0.0, 0.0, 0.0), None)


@dataclass(frozen=True, slots=True)
class EstimatorHealth:
    """Counters since the start: frames seen and refused, beads lost (sum), whole-image searches; drift_px:
    how far the untouched skin has gone since the reference frames or the last tare, root mean square."""

    frames: int
    refused: int
    beads_lost: int
    searches: int
    drift_px: float


class Method(Enum):
    """How a contact is computed from the beads."""

    PAPER = "paper"
    CORRECTED = "corrected"


def best_method(calibration: Calibration) -> Method:
    """Corrected when the calibration holds a model."""
    return Method.CORRECTED if calibration.model else Method.PAPER


class Estimator:
    """One sensor's estimator: beads, then contact and force by the paper's method or by the correction model.

    It keeps the beads' last places, the tare and the drift from frame to frame, and nothing else.
    """

    def __init__(self, calibration: Calibration, method: Method | None = None) -> None:
        """method: :func:`best_method` when not given. Raises CalibrationError when the calibration holds no
        model for it, or one that cannot be used."""
        self.method = method or best_method(calibration)
        self._calibration = calibration
        self._correction = self._load_correction() if self.method is Method.CORRECTED else None
        self._sensor = calibration.sensor
        self._view = View(self._sensor.camera, calibration.pose)
        self._ring_of = calibration.ring_of()
        self._tracker = Tracker(calibration.reference())
        self._rest_on(calibration.reference())
        self._refused = 0
        self._last_image: Image | None = None
        self._slip = SlipWatch()
        self._tare_left = 0
        self._tare_sum = np.zeros_like(self._rest.position_px)
        self._tare_count = np.zeros(len(self._rest.position_px))

    @property
    def health(self) -> EstimatorHealth:
        counters = self._tracker.counters
        return EstimatorHealth(
            counters.frames, self._refused, counters.beads_lost, counters.searches, self._drift.total_px
        )

    def tare(self) -> None:
        """Take the mean of the next `TARE_FRAMES` frames as the untouched sensor.

        A bead that none of them shows keeps the rest place it had.
        """
        self._tare_sum = np.zeros_like(self._rest.position_px)
        self._tare_count = np.zeros(len(self._rest.position_px))
        self._tare_left = TARE_FRAMES

    def estimate(self, frame: Frame) -> Contact:
        """The contact that a frame shows; one that cannot be believed gives `valid` False and a reason."""
        reason = self._unusable(frame.image)
        self._last_image = frame.image
        if reason:
            return self._refuse(frame, reason, 0)
        beads = self._tracker.follow(plane(frame.image, self._calibration.appearance))
        expected = len(beads.found)
        found = expected - len(beads.lost)
        hidden = self._reader.hidden(beads)
        if self._tare_left and not self._doubt(beads, self._motion.read(beads), hidden):
            self._take_tare(beads)
            return self._refuse(frame, "tare in progress", found)
        beads = self._drift.settled(beads)
        motion = self._motion.read(beads)
        reason = self._doubt(beads, motion, hidden)
        if reason:
            self._tracker.reset()
            return self._refuse(frame, reason, found)
        motion_px = motion.size_px
        skin = self._drift.judge(beads, motion_px, frame.exposed_at_us)
        if skin is Skin.KNOCKED:
            return self._refuse(frame, "the beads have moved as one: a knocked camera; tare", found)
        touched = skin is Skin.TOUCHED
        contact = self._contact(beads, hidden) if touched else NO_TOUCH
        radius95_mm = self._if_faint(contact.radius95_mm, motion_px)
        if contact.misfit > self._most_misfit(motion_px, radius95_mm or 0.0):
            return self._refuse(
                frame, "skin moves unlike any single press: a torn frame, or several contacts", found
            )
        answer = Contact(
            sequence=frame.sequence,
            exposed_at_us=frame.exposed_at_us,
            valid=True,
            in_contact=touched,
            position_mm=contact.position_mm,
            normal_force_N=contact.normal_force_N,
            force_N=contact.force_N,
            torsion_Nmm=None,
            quality=found / expected,
            reason="",
            beads_found=found,
            beads_expected=expected,
            radius95_mm=radius95_mm,
        )
        return replace(answer, slip=True) if self._slip.slips(answer) else answer

    def _if_faint(self, radius95_mm: float | None, motion_px: float) -> float | None:
        """The model's radius for a touch of that size; at most the dome's, which is anywhere."""
        if radius95_mm is None:
            return None
        more = faintness(motion_px, self._calibration.contact_threshold_px)
        return min(radius95_mm * more, self._sensor.dome.outer_radius_mm)

    def _most_misfit(self, motion_px: float, radius95_mm: float) -> float:
        """The misfit that a single contact may have."""
        noise = self._calibration.contact_threshold_px / motion_px
        answer = radius95_mm / self._sensor.dome.outer_radius_mm
        return MAX_MISFIT + NOISE_MISFIT * noise**2 + ANSWER_MISFIT * answer**2

    def _doubt(self, beads: Beads, motion: Motion, hidden: Hidden) -> str:
        """Why the beads cannot be those of this skin, or do not tell enough of it; empty when they do."""
        expected = len(beads.found)
        found = expected - len(beads.lost)
        if found < MIN_BEADS_SHARE * expected:
            return f"only {found} of {expected} beads found"
        if motion.roughness > MAX_ROUGHNESS:
            return "beads do not move as one skin: another sensor, or no dome"
        if hidden.blind_spot > MAX_BLIND_SPOT:
            return "the beads of a whole region are hidden"
        return ""

    def _contact(self, beads: Beads, hidden: Hidden) -> _Touch:
        if self._correction is None:
            return self._by_paper(beads)
        return self._by_model(beads, hidden, self._correction)

    def _by_model(self, beads: Beads, hidden: Hidden, correction: CorrectionModel) -> _Touch:
        """The correction model; the normal force is the force's part along the inward normal."""
        result = correction.correct(self._reader.read(beads, hidden=hidden))
        (x, y, z), (x_N, y_N, z_N) = result.direction, result.force_N
        radius_mm = self._sensor.dome.outer_radius_mm
        position = radius_mm * x, radius_mm * y, radius_mm * z
        if self._calibration.stiffness_scale is None:
            return _Touch(position, None, None, result.radius95_mm, result.misfit)
        normal_N = max(0.0, -(x * x_N + y * y_N + z * z_N))
        return _Touch(position, normal_N, result.force_N, result.radius95_mm, result.misfit)

    def _by_paper(self, beads: Beads) -> _Touch:
        """Eqs. (1)-(3); all of the force along the inward normal."""
        model = self._calibration.paper
        points = self._mesh.points(beads.position_px, beads.found)
        raw = raw_contact(self._mesh, points, self._view, self._sensor.markers.radius_mm)
        theta = corrected_theta(model, raw.theta_rad)
        position = on_dome(theta, raw.phi_rad, self._sensor.dome.outer_radius_mm)
        normal_N = normal_force(model, theta, raw.spread_px)
        inward = -position / self._sensor.dome.outer_radius_mm
        return _Touch(
            _vector(position), normal_N, None if normal_N is None else _vector(normal_N * inward), None
        )

    def _load_correction(self) -> CorrectionModel:
        if not self._calibration.model:
            raise CalibrationError(
                "the calibration holds no correction model: choose the method paper, or run palpate-edge "
                "calibrate with presses"
            )
        return CorrectionModel(self._calibration.model, self._calibration.sensor.fingerprint())

    def _rest_on(self, rest: Reference) -> None:
        """Measure motion and areas from `rest` on."""
        self._rest = rest
        self._motion = SkinMotion(rest)
        self._drift = Drift(rest, self._calibration.contact_threshold_px)
        self._mesh = VirtualPointMesh(rest.position_px, self._ring_of)
        self._reader = DisplacementReader(rest.position_px, self._view, self._sensor.markers.radius_mm)

    def _take_tare(self, beads: Beads) -> None:
        self._tare_sum[beads.found] += beads.position_px[beads.found]
        self._tare_count += beads.found
        self._tare_left -= 1
        if self._tare_left == 0:
            mean = self._tare_sum / np.maximum(self._tare_count, 1)[:, None]
            seen = self._tare_count[:, None] > 0
            self._rest_on(replace(self._rest, position_px=np.where(seen, mean, self._rest.position_px)))

    def _unusable(self, image: Image) -> str:
        """Why an image cannot hold the beads at all; empty when it can."""
        width, height = self._sensor.image_size_px
        if image.shape[:2] != (height, width):
            return f"frame is {image.shape[1]}x{image.shape[0]}, the calibration is for {width}x{height}"
        if self._is_last(image):
            return "frame is the same as the one before: the camera is frozen"
        _, deviation = cv2.meanStdDev(image[::BLANK_ROWS])
        return "frame is blank" if max(deviation.ravel().tolist()) < MIN_DEVIATION else ""

    def _is_last(self, image: Image) -> bool:
        """A camera's noise never repeats; the middle row tells most frames apart."""
        last, middle = self._last_image, len(image) // 2
        if last is None or last.shape != image.shape:
            return False
        return last[middle].tobytes() == image[middle].tobytes() and np.array_equal(last, image)

    def _refuse(self, frame: Frame, reason: str, found: int) -> Contact:
        self._refused += 1
        return refused_contact(
            frame.sequence, frame.exposed_at_us, reason, found, len(self._rest.position_px)
        )


def _vector(values: Array) -> Vector3:
    return float(values[0]), float(values[1]), float(values[2])
