"""The pose estimator: frame -> pose of the flat object on it, each frame on its own.

check image -> detect spots -> expect every marker by the density -> pair -> displacement -> labels.
No input or output, no clock, no state but the last image (a camera that is frozen is noticed).
"""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array, Floats, Image
from palpate_edge.common.contact import Contact, LabelEstimate, refused_contact
from palpate_edge.common.contact_quantities import SensorOutputs
from palpate_edge.common.frame import Frame
from palpate_edge.estimation.frame_estimator import BeadsInView, EstimatorHealth, Method
from palpate_edge.estimation.frame_record import FrameRejectedError
from palpate_edge.estimation.image_check import ImageCheck
from palpate_edge.estimation.plausibility import check_doubt, check_found, check_smooth
from palpate_edge.estimation.pose.kernel_expansion import ExpansionRunner
from palpate_edge.estimation.pose.label_runner import LabelRunner
from palpate_edge.estimation.pose.marker_density import MarkerDensity
from palpate_edge.estimation.pose.pairing import PairedMarkers, Pairing
from palpate_edge.estimation.pose.pose_calibration import Guide, Modes, PoseCalibration
from palpate_edge.estimation.pose.spot_detection import SpotDetector
from palpate_edge.vision.appearance import plane
from palpate_edge.vision.neighbourhood import rms


class Projector:
    """Coordinates (m,) of observations (d,) in their modes, and back."""

    def __init__(self, modes: Modes) -> None:
        self._mean, self._vectors = modes.mean.array(), np.ascontiguousarray(modes.vectors.array())

    def coordinates(self, values: Array | Floats) -> Floats:
        """Return the coordinates (m,) of values (d,)."""
        return np.asarray((values.astype(np.float32) - self._mean) @ self._vectors)

    def values(self, coordinates: Floats) -> Floats:
        """Return the values (d,) with these coordinates (m,)."""
        return np.asarray(self._vectors @ coordinates + self._mean)


class ExpectedDisplacement:
    """About how far every marker is displaced, from the density of all markers."""

    def __init__(self, guide: Guide, displacement: Projector, density: MarkerDensity) -> None:
        self._density, self._projector, self._displacement = density, Projector(guide.density), displacement
        self._runner = ExpansionRunner(guide.expansion, guide.centres.array())

    def of(self, spots_px: Array) -> Array:
        """Return the displacement (n, 2) px of every marker, from spots (m, 2) in any order."""
        point = self._projector.coordinates(self._density.of(spots_px))
        return np.asarray(self._displacement.values(self._runner.at(point)).reshape(-1, 2), dtype=np.float64)


class PoseEstimator:
    """Estimates the pose labels that a calibration learned."""

    method = Method.POSE
    outputs = SensorOutputs(place=False, force=False, pose=True)
    picture = None

    def __init__(self, calibration: PoseCalibration) -> None:
        self._calibration = calibration
        self._frames = self._refused = self._beads_lost = 0
        self._rest_px = calibration.rest_px()
        self._match: PairedMarkers | None = None
        self._image_check = ImageCheck(calibration.sensor.image_size_px, calibration.appearance.channel)
        self._detector = SpotDetector(
            calibration.diameter_px, calibration.weakest_strength, len(self._rest_px)
        )
        self._displacement = Projector(calibration.displacement)
        density = MarkerDensity(self._rest_px)
        self._expected = ExpectedDisplacement(calibration.guide, self._displacement, density)
        self._pairing = Pairing(self._rest_px)
        self._labels = LabelRunner(calibration)

    def estimate(self, frame: Frame) -> Contact:
        """Return the contact of a frame; a rejected frame gives `valid` False and the reason."""
        contact = self._estimate(frame)
        self._frames += 1
        self._refused += not contact.valid
        self._beads_lost += contact.beads_expected - contact.beads_found
        return contact

    @property
    def health(self) -> EstimatorHealth:
        """Counters since the start."""
        return EstimatorHealth(self._frames, self._refused, self._beads_lost)

    @property
    def beads(self) -> BeadsInView | None:
        """The markers of the last frame."""
        match = self._match
        return None if match is None else BeadsInView(match.position_px, self._rest_px, match.found)

    def tare(self, *, accepts_contact: bool) -> None:
        """Do nothing: the labels were learned with the places of the markers at rest."""

    def _estimate(self, frame: Frame) -> Contact:
        expected = len(self._rest_px)
        self._match = None
        try:
            match = self._match = self.markers(frame.image)
        except FrameRejectedError as rejection:
            return refused_contact(frame.sequence, frame.exposed_at_us, str(rejection), 0, expected)
        found = int(match.found.sum())
        try:
            check_found(found, expected)
            check_doubt(match.doubt)
            check_smooth(match.roughness)
        except FrameRejectedError as rejection:
            return refused_contact(frame.sequence, frame.exposed_at_us, str(rejection), found, expected)
        moved_px = match.position_px - self._rest_px
        return Contact(
            sequence=frame.sequence,
            exposed_at_us=frame.exposed_at_us,
            valid=True,
            in_contact=rms(moved_px) > self._calibration.contact_threshold_px,
            position_mm=None,
            normal_force_N=None,
            force_N=None,
            quality=found / expected,
            reason="",
            beads_found=found,
            beads_expected=expected,
            pose=self._pose(moved_px),
        )

    def markers(self, image: Image) -> PairedMarkers:
        """Return the markers of an image. Raises FrameRejectedError for an image of another size or none."""
        self._image_check.check_image(image)
        spots = self._detector.find(plane(image, self._calibration.appearance))
        return self._pairing.match(self._rest_px + self._expected.of(spots.position_px), spots)

    def _pose(self, moved_px: Array) -> tuple[LabelEstimate, ...]:
        point = self._displacement.coordinates(moved_px.ravel())
        values, half_widths = self._labels.at(point), self._labels.half_widths_at(point)
        return tuple(
            LabelEstimate(label, value, half_width)
            for label, value, half_width in zip(
                self._calibration.labels, values.tolist(), half_widths.tolist(), strict=True
            )
        )
