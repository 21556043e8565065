"""Milliseconds a frame of the estimator's stages, beside what others would use for the same work."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from bench.frames import Material
from bench.timing import Row, time_each
from palpate_edge.correction import CorrectionModel
from palpate_edge.displacement import DisplacementReader
from palpate_edge.estimator import Estimator, Method
from palpate_edge.markers import find_blobs, plane
from palpate_edge.motion import SkinMotion
from palpate_edge.sensor import View
from palpate_edge.tracking import Tracker

Array = NDArray[np.float64]


def rows(material: Material) -> list[Row]:
    """All rows of the estimator's table; the first is the yardstick."""
    calibration, frames = material.calibration, material.frames
    reference = calibration.reference()
    planes = [plane(frame.image, calibration.appearance) for frame in frames]
    tracker, skin = Tracker(reference), SkinMotion(reference)
    view = View(calibration.sensor.camera, calibration.pose)
    reader = DisplacementReader(reference.position_px, view, calibration.sensor.markers.radius_mm)
    beads = [tracker.follow(dark) for dark in planes]
    fields = [reader.read(bead) for bead in beads]
    model = CorrectionModel(calibration.model, calibration.sensor.fingerprint())
    corrected, paper = Estimator(calibration, Method.CORRECTED), Estimator(calibration, Method.PAPER)
    diameter_px = float(np.median(reference.diameter_px))
    alternative = OpenCvAlternative(calibration.ring_of(), reference.position_px)
    return [
        Row("grey JPEG decoding (the yardstick)", time_each(decode, material.jpegs)),
        Row("corrected estimate, image to force", time_each(corrected.estimate, frames)),
        Row("paper's estimate, image to force", time_each(paper.estimate, frames)),
        Row("  follow the beads", time_each(tracker.follow, planes)),
        Row("  touch test", time_each(skin.size_px, beads)),
        Row("  canonical displacement field", time_each(reader.read, beads)),
        Row("  correction model", time_each(model.correct, fields)),
        Row("find the beads in a whole image", time_each(lambda p: find_blobs(p, diameter_px), planes)),
        Row("SimpleBlobDetector + fitEllipse + scipy Delaunay", time_each(alternative, planes[:60])),
    ]


def decode(jpeg: NDArray[np.uint8]) -> object:
    return cv2.imdecode(jpeg, cv2.IMREAD_GRAYSCALE)


class OpenCvAlternative:
    """What most visual-tactile software does: a blob detector, an ellipse a ring, a fresh triangulation."""

    def __init__(self, ring_of: NDArray[np.intp], reference_px: Array) -> None:
        parameters = cv2.SimpleBlobDetector.Params()
        parameters.filterByArea = True
        parameters.minArea, parameters.maxArea = 40.0, 900.0
        parameters.filterByConvexity = parameters.filterByInertia = False
        self._detector = cv2.SimpleBlobDetector.create(parameters)
        self._rings = [np.flatnonzero(ring_of == ring) for ring in np.unique(ring_of)]
        self._reference_px = reference_px

    def __call__(self, grey: NDArray[np.uint8]) -> object:
        points = np.array([point.pt for point in self._detector.detect(grey)])
        nearest = ((self._reference_px[:, None] - points[None]) ** 2).sum(axis=2).argmin(axis=1)
        beads = points[nearest].astype(np.float32)
        ellipses = [cv2.fitEllipse(beads[ring]) for ring in self._rings if len(ring) >= 6]
        return ellipses, Delaunay(beads)
