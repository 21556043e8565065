"""The calibration file: all that the estimator knows of one sensor, in one checked JSON file."""

from __future__ import annotations

import hashlib
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.atomic_write import whole_file
from palpate_edge.common.errors import CalibrationError
from palpate_edge.estimation.paper_method import PaperModel
from palpate_edge.geometry.sensor import CameraPose, Sensor
from palpate_edge.vision.blob_detection import Appearance, unlit_grey
from palpate_edge.vision.shading import SkinLight
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


class Source(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
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
    source: Source
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
            light=SkinLight(
                np.array([(bead.slope_x, bead.slope_y) for bead in self.beads]), unlit_grey(self.appearance)
            ),
            unevenness=np.array([bead.unevenness for bead in self.beads]),
        )

    def ring_of(self) -> NDArray[np.intp]:
        """Ring index of each bead, (n,)."""
        return np.array([bead.ring for bead in self.beads], dtype=np.intp)


def save_calibration(calibration: Calibration, path: Path) -> None:
    """Write the file whole or not at all: temporary file, fsync, rename."""
    sealed = msgspec.structs.replace(calibration, checksum=calibration.digest())
    with whole_file(path, CalibrationError) as temporary:
        temporary.write_bytes(_text(sealed))


def _text(calibration: Calibration) -> bytes:
    """The one way in which a calibration is written down."""
    return msgspec.json.format(msgspec.json.encode(calibration), indent=1) + b"\n"


def load_calibration(path: Path) -> Calibration:
    """Read and check a calibration file. Raises CalibrationError naming the file and the way out."""
    again = "make it again with palpate-edge calibrate"
    try:
        data = path.read_bytes()
        calibration = msgspec.json.decode(data, type=Calibration)
    except FileNotFoundError:
        raise CalibrationError(f"{path} is missing: make it with palpate-edge calibrate") from None
    except OSError as error:
        raise CalibrationError(f"{path} cannot be read: {error.strerror}") from None
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        raise CalibrationError(f"{path} is no whole calibration ({error}): {again}") from None
    if calibration.format != FORMAT or calibration.version != VERSION:
        raise CalibrationError(
            f"{path} is {calibration.format} version {calibration.version}, this program reads "
            f"{FORMAT} version {VERSION}: {again}"
        )
    if calibration.checksum != calibration.digest() or data != _text(calibration):
        raise CalibrationError(f"{path} was changed or damaged (its checksum does not match): {again}")
    return calibration


def check_sensor(calibration: Calibration, calibration_path: Path, sensor: Sensor, where: Path) -> None:
    """Refuse a calibration that was made for another sensor than the one described in `where`."""
    ours, theirs = calibration.sensor.fingerprint(), sensor.fingerprint()
    if ours != theirs:
        raise CalibrationError(
            f"calibration {calibration_path} was made for sensor {ours}, {where} describes {theirs}: "
            "run palpate-edge calibrate for it"
        )
