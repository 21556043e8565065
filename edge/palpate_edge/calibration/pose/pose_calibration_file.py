"""Read and write the calibration file of a pose sensor: one checked JSON file."""

from __future__ import annotations

from pathlib import Path

import msgspec

from palpate_edge.calibration.calibration_file import AGAIN, FileHead, read_calibration_bytes
from palpate_edge.common.atomic_write import write_atomically
from palpate_edge.common.config_file import decoder_of, json_fault
from palpate_edge.common.errors import CalibrationError
from palpate_edge.common.type_text import value_text
from palpate_edge.estimation.pose.pose_calibration import FORMAT, VERSION, PoseCalibration


def is_pose_calibration(path: Path) -> bool:
    """Return whether a file is a pose calibration, of any version; False when it cannot be read."""
    try:
        return decoder_of(FileHead).decode(path.read_bytes()).format == FORMAT
    except (OSError, msgspec.DecodeError, ValueError, RecursionError):
        return False


def save_pose_calibration(calibration: PoseCalibration, path: Path) -> None:
    """Write the file with its checksum, whole or not at all. Raises CalibrationError."""
    sealed = msgspec.structs.replace(calibration, checksum=calibration.digest())
    write_atomically(path, msgspec.json.encode(sealed) + b"\n", CalibrationError)


def load_pose_calibration(path: Path) -> PoseCalibration:
    """Read and check a calibration file. Raises CalibrationError with the file, the fault and the way out."""
    data = read_calibration_bytes(path)
    try:
        head = decoder_of(FileHead).decode(data)
        if head.format == FORMAT and head.version != VERSION:
            raise CalibrationError(
                f"{path} is {value_text(head.format)} version {head.version}, this program reads version "
                f"{VERSION}: {AGAIN}"
            )
        calibration = decoder_of(PoseCalibration).decode(data)
    except (msgspec.DecodeError, ValueError, RecursionError):
        raise CalibrationError(f"{path}: {json_fault(data, PoseCalibration)}; {AGAIN}") from None
    if calibration.format != FORMAT or calibration.checksum != calibration.digest():
        raise CalibrationError(f"{path} was changed or damaged (its checksum does not match): {AGAIN}")
    return calibration
