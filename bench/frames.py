"""Material for timing the estimator: a calibration, and frames of a moving contact as JPEG files."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.calibration_file import load_calibration, save_calibration
from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.datasets.recording import all_frames, open_recording
from palpate_edge.estimation.calibration import Calibration

ROOT = Path(__file__).resolve().parents[1]
RECORDING = ROOT / "demo" / "recording"
SHARED = ROOT.parent / "shared" / "data"  # optional data next to the project's folder
JPEG_QUALITY = 90


@dataclass(frozen=True, slots=True)
class Material:
    """Calibration and frames of a moving contact as JPEG data. name: for the table's title."""

    name: str
    calibration: Calibration
    jpegs: tuple[NDArray[np.uint8], ...]


@cache
def demo_material() -> Material:
    """Return the recording of the demo's first finger as grey JPEG frames."""
    calibration = calibrated(RECORDING / "press")
    recording = open_recording(RECORDING / "finger-1")
    jpegs = tuple(_grey_jpeg(frame.image) for frame in all_frames(recording))
    recording.close()
    return Material("the demo's recording as grey JPEG", calibration, jpegs)


def materials() -> Iterator[Material]:
    """Yield the demo's material and, if available, that of the first press sequence."""
    yield demo_material()
    sequence = SHARED / "press-sequences" / "finger-1"
    if sequence.is_dir():
        frames = sorted((sequence / "frames").glob("*.jpg"))
        jpegs = tuple(np.fromfile(path, np.uint8) for path in frames)
        yield Material("press-sequences/finger-1", calibrated(SHARED / "press-sample"), jpegs)


@cache
def calibrated(presses: Path) -> Calibration:
    """Return a calibration that was written to a file and read again, as in use."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.cal"
        save_calibration(calibrate(read_dataset(presses), dome=load_dome_model()), path)
        return load_calibration(path)


def _grey_jpeg(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
    quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    return np.asarray(cv2.imencode(".jpg", grey, quality)[1], np.uint8)
