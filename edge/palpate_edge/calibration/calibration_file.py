"""Read and write the calibration file: one checked JSON file for each sensor."""

from __future__ import annotations

from pathlib import Path

import msgspec

from palpate_edge.common.atomic_write import whole_file
from palpate_edge.common.errors import CalibrationError
from palpate_edge.estimation.calibration import FORMAT, VERSION, Calibration
from palpate_edge.geometry.sensor import Sensor


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
