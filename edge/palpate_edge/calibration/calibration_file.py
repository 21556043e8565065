"""Read and write the calibration file: one checked JSON file for each sensor."""

from __future__ import annotations

from pathlib import Path

import msgspec

from palpate_edge.common.atomic_write import write_atomically
from palpate_edge.common.config_file import decoder_of, json_fault
from palpate_edge.common.errors import CalibrationError, reason_of
from palpate_edge.common.type_text import value_text
from palpate_edge.estimation.calibration import FORMAT, VERSION, Calibration
from palpate_edge.estimation.pose.pose_calibration import FORMAT as POSE_FORMAT
from palpate_edge.geometry.picture_sensor import PictureSensor
from palpate_edge.geometry.sensor import Sensor

AnySensor = Sensor | PictureSensor
AGAIN = "make it again with palpate-edge calibrate"


class FileHead(msgspec.Struct, frozen=True):
    """The keys that every kind and version of calibration file has."""

    format: str
    version: int


def save_calibration(calibration: Calibration, path: Path) -> None:
    """Write the file with its checksum, whole or not at all. Raises CalibrationError."""
    sealed = msgspec.structs.replace(calibration, checksum=calibration.digest())
    write_atomically(path, _text(sealed), CalibrationError)


def _text(calibration: Calibration) -> bytes:
    """Return the only JSON text that is accepted for this calibration."""
    return msgspec.json.format(msgspec.json.encode(calibration), indent=1) + b"\n"


def load_calibration(path: Path) -> Calibration:
    """Read and check a calibration file. Raises CalibrationError with the file, the fault and the way out."""
    data = read_calibration_bytes(path)
    try:
        calibration = decoder_of(Calibration).decode(data)
    except (msgspec.DecodeError, ValueError, RecursionError):
        _check_version(data, path)
        raise CalibrationError(f"{path}: {json_fault(data, Calibration)}; {AGAIN}") from None
    _check_version(data, path)
    if calibration.checksum != calibration.digest() or data != _text(calibration):
        raise CalibrationError(f"{path} was changed or damaged (its checksum does not match): {AGAIN}")
    return calibration


def read_calibration_bytes(path: Path) -> bytes:
    """Return the content of a calibration file of either kind. Raises CalibrationError."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise CalibrationError(f"{path}: {reason_of(error)}; make it with palpate-edge calibrate") from None


def _check_version(data: bytes, path: Path) -> None:
    """Refuse a file of another program or version; a damaged one is left to the caller."""
    try:
        head = decoder_of(FileHead).decode(data)
    except (msgspec.DecodeError, ValueError, RecursionError):
        return
    if head.format == POSE_FORMAT:
        raise CalibrationError(
            f"{path} calibrates pose labels, not contacts: use it with palpate-edge run, estimate or evaluate"
        )
    if head.format != FORMAT or head.version != VERSION:
        raise CalibrationError(
            f"{path} is {value_text(head.format)} version {head.version}, this program reads "
            f"{FORMAT} version {VERSION}: {AGAIN}"
        )


def check_sensor(calibrated: AnySensor, calibration_path: Path, sensor: AnySensor, where: Path) -> None:
    """Refuse a calibration of another sensor than the one that the file `where` describes."""
    ours, theirs = calibrated.fingerprint(), sensor.fingerprint()
    if ours != theirs:
        raise CalibrationError(
            f"calibration {calibration_path} was made for sensor {ours}, {where} describes {theirs}: "
            "make one for it with palpate-edge calibrate"
        )
