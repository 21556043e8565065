"""The calibration file: all that the estimator knows of one sensor, in one checked JSON file."""

from __future__ import annotations

import hashlib

import msgspec
import numpy as np
from numpy.typing import NDArray

from palpate_edge.estimation.paper_method import PaperModel
from palpate_edge.geometry.sensor import CameraPose, Sensor
from palpate_edge.vision.blob_detection import Appearance, unlit_grey
from palpate_edge.vision.shading import Shading
from palpate_edge.vision.tracker import Reference

FORMAT = "palpate-calibration"
VERSION = 4


class Bead(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One bead of the untouched sensor: place, size and contrast in the image, slope of the skin's grey
    (over the contrast, a pixel) and its unevenness about the bead, and its ring."""

    x_px: float
    y_px: float
    diameter_px: float
    contrast: float
    area: float
    slope_x: float
    slope_y: float
    unevenness: float
    ring: int


class CalibrationSource(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a calibration was made from."""

    dataset: str
    reference_frames: int
    presses: int


class Calibration(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One sensor's calibration.

    contact_threshold_px: bead motion (root mean square) above which something touches;
    contact_threshold_N: the normal force that makes it where the dome is stiffest, None when no press told;
    residual_px: root mean square distance of the beads from the fitted layout; model: the correction model's
    ONNX file, empty without one; stiffness_scale: the sensor's forces over the dome model's, None when no
    press told and the model's forces mean nothing; checksum: over everything else, the model included.
    """

    sensor: Sensor
    pose: CameraPose
    appearance: Appearance
    beads: tuple[Bead, ...]
    contact_threshold_px: float
    paper: PaperModel
    residual_px: float
    source: CalibrationSource
    model: bytes = b""
    stiffness_scale: float | None = None
    contact_threshold_N: float | None = None
    format: str = FORMAT
    version: int = VERSION
    checksum: str = ""

    def digest(self) -> str:
        """SHA-256, hex, over all fields but the checksum."""
        return hashlib.sha256(msgspec.json.encode(msgspec.structs.replace(self, checksum=""))).hexdigest()

    def reference(self) -> Reference:
        return Reference(
            position_px=np.array([(bead.x_px, bead.y_px) for bead in self.beads]),
            diameter_px=np.array([bead.diameter_px for bead in self.beads]),
            contrast=np.array([bead.contrast for bead in self.beads]),
            area=np.array([bead.area for bead in self.beads]),
            light=Shading(
                np.array([(bead.slope_x, bead.slope_y) for bead in self.beads]), unlit_grey(self.appearance)
            ),
            unevenness=np.array([bead.unevenness for bead in self.beads]),
        )

    def ring_of(self) -> NDArray[np.intp]:
        """Ring index of each bead, (n,)."""
        return np.array([bead.ring for bead in self.beads], dtype=np.intp)
