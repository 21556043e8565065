"""Processor time per frame of the estimator's stages, compared with common alternatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import count

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from bench.frames import Material, materials
from bench.timing import Item, Row, table, time_both
from palpate_edge.common.arrays import Array, Image
from palpate_edge.common.frame import Frame
from palpate_edge.estimation.correction_model import CorrectionModel
from palpate_edge.estimation.displacement_field import DisplacementReader
from palpate_edge.estimation.estimator import Estimator
from palpate_edge.estimation.frame_estimator import Method
from palpate_edge.estimation.skin_motion import SkinMotion
from palpate_edge.geometry.sensor import View
from palpate_edge.vision.appearance import plane
from palpate_edge.vision.blob_detection import find_blobs
from palpate_edge.vision.tracker import Tracker

Seconds = NDArray[np.float64]

FRAME_US = 33_333
ALTERNATIVE_FRAMES = 60  # fewer frames because the alternative is slow


def report() -> str:
    """Return a table for each recording; every stage is timed on a frame that has just been decoded."""
    return "\n\n".join(map(_report, materials()))


def _report(material: Material) -> str:
    found = rows(material)
    return table(f"Estimator, processor time, one core: {material.name}", found, against=found[-1])


def rows(material: Material) -> list[Row]:
    """Return all rows; the first is the reference (b) for the ratios, the last the alternative (a)."""
    calibration, jpegs = material.calibration, material.jpegs
    reference = calibration.reference()
    planes = [plane(decode(jpeg), calibration.appearance) for jpeg in jpegs]
    tracker, skin = Tracker(reference), SkinMotion(reference)
    view = View(calibration.sensor.camera, calibration.pose)
    reader = DisplacementReader(reference.position_px, view, calibration.sensor.markers.radius_mm)
    beads = [tracker.follow(dark) for dark in planes]
    fields = [reader.read(bead) for bead in beads]
    model = CorrectionModel(calibration.model, calibration.sensor.fingerprint())
    corrected, paper = (Estimator(calibration, method) for method in (Method.CORRECTED, Method.PAPER))
    diameter_px = float(np.median(reference.diameter_px))
    plain = OpenCvAlternative(calibration.ring_of(), reference.position_px)
    lenient = OpenCvAlternative(calibration.ring_of(), reference.position_px, lenient=True)
    number = count()

    def framed(image: Image) -> Frame:
        index = next(number)
        return Frame(image, index * FRAME_US, index, "")

    def after(things: Sequence[Item], call: Callable[[Item], object]) -> Seconds:
        """Time a stage on the output of the stage before, right after decoding the frame."""
        pairs = list(zip(jpegs, things, strict=True))
        return time_both(lambda pair: (decode(pair[0]), pair[1])[1], call, pairs)[1]

    decoding_s, corrected_s = time_both(decode, lambda image: corrected.estimate(framed(image)), jpegs)
    _, paper_s = time_both(decode, lambda image: paper.estimate(framed(image)), jpegs)
    _, follow_s = time_both(decode, tracker.follow, jpegs)
    _, search_s = time_both(decode, lambda image: find_blobs(image, diameter_px), jpegs)
    _, plain_s = time_both(decode, plain, jpegs[:ALTERNATIVE_FRAMES])
    _, lenient_s = time_both(decode, lenient, jpegs[:ALTERNATIVE_FRAMES])
    return [
        Row("grey JPEG decoding (b)", decoding_s),
        Row("corrected estimate, image to force", corrected_s),
        Row("paper's estimate, image to force", paper_s),
        Row("  follow the beads", follow_s),
        Row("  touch test", after(beads, skin.measure)),
        Row("  canonical displacement field", after(beads, reader.read)),
        Row("  correction model", after(fields, model.correct)),
        Row("find the beads in a whole image", search_s),
        Row("(a) with neither convexity nor inertia filtered", lenient_s),
        Row("SimpleBlobDetector + fitEllipse + scipy Delaunay (a)", plain_s),
    ]


def decode(jpeg: Image) -> Image:
    return np.asarray(cv2.imdecode(jpeg, cv2.IMREAD_GRAYSCALE), np.uint8)


class OpenCvAlternative:
    """Common approach of visual-tactile software: blob detector, one ellipse per ring, new triangulation.

    The detector processes the whole frame with OpenCV's default parameters, which find all beads of both
    recordings. lenient: without its two slowest filters, and with limits on the area.
    """

    def __init__(self, ring_of: NDArray[np.intp], reference_px: Array, *, lenient: bool = False) -> None:
        parameters = cv2.SimpleBlobDetector.Params()
        if lenient:
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
