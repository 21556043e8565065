"""Stand-in for the estimator without a calibration: pictures are measured, and no contact is valid.

The daemon runs with it, so that camera, light and bus can be set up before the sensor is calibrated.
"""

from __future__ import annotations

from palpate_edge.common.contact import Contact, refused_contact
from palpate_edge.common.contact_quantities import SensorOutputs
from palpate_edge.common.frame import Frame
from palpate_edge.estimation.frame_estimator import EstimatorHealth
from palpate_edge.vision.picture_measure import PictureMeasure, measure_picture

MEASURE_EVERY_US = 2_000_000
NO_CALIBRATION = "no calibration: no contact is valid; make one with palpate-edge calibrate"


class UncalibratedEstimator:
    """Measures a picture every two seconds; every contact is refused with the reason `NO_CALIBRATION`.

    picture: the last measures.
    """

    method = None
    outputs = SensorOutputs()
    beads = None

    def __init__(self, beads_expected: int = 0) -> None:
        """beads_expected: of the sensor's description; 0 when it is unknown."""
        self.picture: PictureMeasure | None = None
        self._beads_expected = beads_expected
        self._measure_at_us = 0
        self._frames = 0

    def estimate(self, frame: Frame) -> Contact:
        """Return the refused contact of a frame, with the number of blobs in the last measured picture."""
        self._frames += 1
        if self.picture is None or frame.exposed_at_us >= self._measure_at_us:
            self._measure_at_us = frame.exposed_at_us + MEASURE_EVERY_US
            self.picture = measure_picture(frame.image)
        return refused_contact(
            frame.sequence, frame.exposed_at_us, NO_CALIBRATION, self.picture.blobs, self._beads_expected
        )

    def tare(self, *, accepts_contact: bool) -> None:
        """Do nothing: there is no reference to renew."""

    @property
    def health(self) -> EstimatorHealth:
        """Counters since the start."""
        return EstimatorHealth(self._frames, self._frames, 0, 0, 0.0)
